from pathlib import Path

import pytest
from uav_collect.uav.own_policy import own_policies, own_policy_file

FIELD = Path('fields', 'north.yaml')


def test_the_policy_of_a_field_lies_beside_its_scenario() -> None:
    assert own_policy_file(FIELD) == Path('fields', 'north.safetensors')
    assert own_policy_file(FIELD, 4) == Path('fields', 'north_n4.safetensors')


def test_policies_beside_a_scenario_are_found_those_of_the_fleet_first(tmp_path: Path) -> None:
    field = tmp_path / 'north.yaml'
    assert own_policies(field, 4) == []

    for name in ('north', 'north_n4', 'north_n3', 'south'):
        (tmp_path / f'{name}.safetensors').touch()

    assert [Path(path).stem for path in own_policies(field, 4)] == ['north_n4', 'north']


def test_beside_a_shipped_scenario_lies_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path('paper_8x8.safetensors').touch()

    assert own_policies('paper_8x8', 2) == []
