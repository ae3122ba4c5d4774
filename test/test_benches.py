"""Benchmarks begin: what they measure is beside the point here."""

from importlib import import_module
from pathlib import Path

import pytest
from uav_collect.uav.policy import shipped_policies

from bench import verify

BENCHES = sorted(path.stem for path in (Path(__file__).parents[1] / 'bench').glob('*.py'))


@pytest.mark.parametrize('name', BENCHES)
def test_a_benchmark_loads(name: str) -> None:
    assert callable(import_module(f'bench.{name}').main)


def test_every_shipped_policy_is_verified_over_ros() -> None:
    assert {*shipped_policies()} <= {case.policy for case in verify.cases()}
