"""Scenarios that somebody asks a world for: by name or as text, never a file of the world's."""

from pathlib import Path

import pytest
from uav_collect.errors import ConfigError
from uav_collect.limits import MAX_SENSORS
from uav_collect.lockstep.requested_scenario import requested_site, ScenariosOfWorld
from uav_collect.scenario.load import fingerprint, load

ALIASES = 'a0: &a0 [1, 1]\n' + ''.join(
    f'a{count}: &a{count} [*a{count - 1}, *a{count - 1}]\n' for count in range(1, 40)
)


def test_a_scenario_is_found_by_its_name_and_read_from_its_text() -> None:
    scenario = load('paper_8x8')
    for asked in ('paper_8x8', scenario.to_yaml()):
        assert fingerprint(requested_site(asked).scenario) == fingerprint(scenario)


def test_a_scenario_of_as_many_sensors_as_there_may_be_is_read_from_its_text() -> None:
    entries = [
        {'id': f'sensor {n:05}', 'x_m': n % 400 + 0.123456, 'y_m': n / 50.0, 'data_mbit': None}
        for n in range(MAX_SENSORS)
    ]
    text = load('paper_8x8', {'sensors': {'kind': 'listed', 'entries': entries}}).to_yaml()
    assert len(text) > 1_000_000
    assert requested_site(text).n_sensors == MAX_SENSORS


@pytest.mark.parametrize(
    ('asked', 'complaint'),
    [
        ('paper', 'must be one of lillgrund'),
        ('extends: paper_8x8\n', 'is missing'),
        ('[\n', 'is not valid YAML'),
        ('[' * 100_000 + '\n', 'must be at most 50 levels'),
        (ALIASES, 'must have at most 520,000 values'),
        ('\n' * 17_000_000, 'has 17,000,000 characters: must have at most 16,777,216'),
    ],
    ids=['name', 'unresolved', 'no YAML', 'deep', 'aliases', 'long'],
)
def test_what_no_fleet_can_fly_is_refused_in_one_line(asked: str, complaint: str) -> None:
    with pytest.raises(ConfigError, match=complaint) as refusal:
        requested_site(asked)
    assert '\n' not in str(refusal.value)


def test_files_of_the_world_stay_closed(tmp_path: Path) -> None:
    file = tmp_path / 'mine.yaml'
    file.write_text(load('paper_8x8').to_yaml())
    with pytest.raises(ConfigError, match='unknown'):
        requested_site(str(file))


def test_a_fleet_that_cannot_start_is_refused() -> None:
    text = load('paper_8x8', {'fleet.default.energy_budget_kj': 1.1}).to_yaml()
    with pytest.raises(ConfigError, match=r'1\.1 kJ'):
        requested_site(text)


@pytest.mark.parametrize(
    'change',
    [
        {'name': 'mine'},
        {'area.reference': {'lat_deg': 1.0, 'lon_deg': 2.0, 'position_m': [0.0, 0.0]}},
    ],
    ids=['name', 'place'],
)
def test_a_world_has_one_scenario_of_each_fingerprint(change: dict[str, object]) -> None:
    scenarios = ScenariosOfWorld()
    for name in ('paper_8x8', 'paper_10x10', 'paper_8x8'):
        scenarios.add(load(name))
    with pytest.raises(ConfigError, match='differs from paper_8x8, which this world has had'):
        scenarios.add(load('paper_8x8', change))
