"""The mean of policies that learned one from another, as a policy of their courses."""

from dataclasses import replace
from pathlib import Path

from episodes import single_threaded_torch
import numpy as np
import pytest
from random_policies import header, random_policy
from small_courses import small_courses
from uav_collect.errors import PolicyMismatchError
from uav_collect.uav.observation import Layout
from uav_collect.uav.operating_domain import OperatingDomain
from uav_collect.uav.policy_file import save_policy

torch = single_threaded_torch()
from tools import average_policies

ONE, OTHER = (
    random_policy(header(Layout.RELATIVE, side=4, advice_bonus=0.1), seed=seed) for seed in (1, 2)
)


def test_weights_are_averaged_by_their_shares() -> None:
    mean = average_policies.averaged([ONE, OTHER], [1.0, 3.0])
    assert mean.header == OTHER.header
    for name, weights in mean.weights.items():
        wanted = 0.25 * ONE.weights[name] + 0.75 * OTHER.weights[name]
        np.testing.assert_allclose(weights, wanted, rtol=1e-6, atol=1e-7)
        assert weights.dtype == np.float32


def test_networks_that_differ_have_no_mean() -> None:
    wide = random_policy(header(Layout.RELATIVE, side=4, hidden_size=8), seed=1)
    with pytest.raises(PolicyMismatchError, match='hidden size is 8: must be 16'):
        average_policies.averaged([wide, OTHER], [1.0, 1.0])


def test_the_mean_has_the_courses_domains_and_is_validated_in_their_panel() -> None:
    courses, domains = small_courses(), (OperatingDomain(n_uavs=(9, 9)),)
    courses = replace(courses, distribution=replace(courses.distribution, domains=domains))
    policy = average_policies.of_courses(ONE, courses, 2)
    assert policy.header.domains == domains
    assert policy.header.n_uavs_max == 16
    assert policy.header.validation.missions == 4
    assert policy.header.validation.efficiency_kbit_per_j > 0.0
    assert policy.header.validation.complete_share == 1.0  # outside of the domain: the sweep


def test_a_wrong_file_is_a_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    save_policy(tmp_path / 'one.safetensors', ONE)
    words = [str(tmp_path / name) for name in ('mean.safetensors', 'one.safetensors', 'none')]
    assert average_policies.main(words) == 2
    assert 'none: cannot be read' in capsys.readouterr().err
    assert not (tmp_path / 'mean.safetensors').exists()


@pytest.mark.parametrize('weight', ['0', '-1', 'nan', 'inf', 'x', ''])
def test_a_weight_is_a_number_above_zero(weight: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        average_policies.main(['mean.safetensors', f'one.safetensors={weight}'])
    said = f'one.safetensors={weight}: the weight must be a number above 0'
    assert said in capsys.readouterr().err
