"""Policies of different domains, joined into one policy of several networks."""

from dataclasses import replace
from pathlib import Path

from episodes import single_threaded_torch
import pytest
from random_policies import header, random_policy
from small_courses import small_courses
from uav_collect.errors import ConfigError, PolicyMismatchError
from uav_collect.scenario.load import load
from uav_collect.uav.briefing import brief
from uav_collect.uav.observation import Layout
from uav_collect.uav.operating_domain import OperatingDomain
from uav_collect.uav.policy_file import load_policy, save_policy
from uav_collect.uav.policy_network import FrozenPolicy

torch = single_threaded_torch()
from uav_collect.learning.course_tasks import check_settings
from uav_collect.learning.headers import network_to_start_from
from uav_collect.learning.minibatch import Algorithm
from uav_collect.training.config import load_preset

from tools import join_policies

WIDE = {'cells_per_side_max': 64, 'n_uavs_max': 16, 'advice_bonus': 0.1}


def of_fleets(n_uavs: int, seed: int, **values: object) -> FrozenPolicy:
    """A policy of random weights that decides for fleets of so many UAVs."""
    domains = (OperatingDomain(n_uavs=(n_uavs, n_uavs)),)
    values = {**WIDE, 'domains': domains, **values}
    return random_policy(header(Layout.RELATIVE, side=1, n_uavs=1, **values), seed=seed)


TWO, THREE = of_fleets(2, seed=1), of_fleets(3, seed=2)


def test_each_network_decides_in_the_domains_of_its_file() -> None:
    both = join_policies.joined([TWO, THREE])
    for n_uavs, own in ((2, TWO), (3, THREE)):
        fleet = load('paper_10x10', {'fleet.uavs': [{'speed_mps': 5.0}] * n_uavs})
        part = both.over(brief(fleet))
        assert part.digest == own.digest
        assert part.header.domains == own.header.domains
    assert both.header.decisions == TWO.header.decisions + THREE.header.decisions
    assert both.header.version == f'paper_10x10_joint-{both.digest[:8]}'


def test_the_file_is_whole_and_validated_in_the_panel(tmp_path: Path) -> None:
    joint = join_policies.validated_in(
        join_policies.joined([TWO, THREE]), small_courses().panel, 2
    )
    assert joint.header.validation.missions == 4
    assert joint.header.validation.efficiency_kbit_per_j > 0.0
    save_policy(tmp_path / 'joint.safetensors', joint)
    assert load_policy(tmp_path / 'joint.safetensors').header == joint.header


@pytest.mark.parametrize(
    ('other', 'why'),
    [
        (of_fleets(3, seed=2, domains=()), 'has no domains'),
        (of_fleets(3, seed=2, advice_bonus=0.2), 'advice_bonus is 0.2: must be 0.1'),
        (of_fleets(3, seed=2, hidden_size=8), 'hidden size is 8: must be 16'),
    ],
)
def test_what_cannot_be_joined_is_refused(other: FrozenPolicy, why: str) -> None:
    with pytest.raises(PolicyMismatchError, match=why):
        join_policies.joined([TWO, other])


def test_a_wrong_file_is_a_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    save_policy(tmp_path / 'one.safetensors', TWO)
    words = [str(tmp_path / name) for name in ('joint.safetensors', 'one.safetensors', 'none')]
    assert join_policies.main(words) == 2
    assert 'none: cannot be read' in capsys.readouterr().err
    assert not (tmp_path / 'joint.safetensors').exists()


def test_where_nothing_can_be_written_is_said_before_missions_fly(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    save_policy(tmp_path / 'two.safetensors', TWO)
    save_policy(tmp_path / 'three.safetensors', THREE)
    monkeypatch.delattr(join_policies, 'validated_in')
    names = ('nowhere/joint.safetensors', 'two.safetensors', 'three.safetensors')
    assert join_policies.main([str(tmp_path / name) for name in names]) == 2
    assert 'nowhere' in capsys.readouterr().err


def test_a_joint_policy_is_no_part_of_another() -> None:
    for policies in (
        [TWO, join_policies.joined([TWO, THREE])],
        [join_policies.joined([TWO, THREE])] * 2,
    ):
        with pytest.raises(PolicyMismatchError, match='has 2 networks: must be one'):
            join_policies.joined(policies)
    with pytest.raises(PolicyMismatchError, match='policies are 1: must be 2 to 8'):
        join_policies.joined([TWO])


def test_the_joint_policy_may_fly_what_any_of_its_networks_may() -> None:
    small = of_fleets(2, seed=1, n_uavs_max=2, cells_per_side_max=8)
    header = join_policies.joined([small, THREE]).header
    assert (header.n_uavs_max, header.cells_per_side_max) == (16, 64)


def test_a_training_starts_from_the_network_that_decides_there() -> None:
    both = join_policies.joined([TWO, THREE])
    fleets = [
        brief(load('paper_10x10', {'fleet.uavs': [{'speed_mps': 5.0}] * n_uavs}))
        for n_uavs in (2, 3, 4)
    ]
    assert network_to_start_from(both, fleets[1:2]).digest == THREE.digest
    assert network_to_start_from(TWO, fleets) is TWO
    for some in (fleets[:2], fleets[2:]):
        with pytest.raises(PolicyMismatchError, match='has 2 networks: must be one that decides'):
            network_to_start_from(both, some)


def test_courses_that_name_a_network_are_refused_before_anything_is_learned() -> None:
    distribution = small_courses().distribution
    domains = (OperatingDomain(n_uavs=(1, 1)), OperatingDomain(n_uavs=(2, 2), network=2))
    distribution = replace(distribution, domains=domains)
    with pytest.raises(ConfigError, match=r'domains\.1\.network is 2: must be absent'):
        check_settings(distribution, load_preset('anywhere'), Algorithm.BRANCHES)
