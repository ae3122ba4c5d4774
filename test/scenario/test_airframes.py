"""UAVs given by craft and battery: the constants that come out, and which word counts."""

from pathlib import Path

import pytest
from uav_collect.errors import ConfigError
from uav_collect.physics.energy import propulsion_power_w
from uav_collect.scenario.airframes import airframe_named, airframe_names
from uav_collect.scenario.load import fingerprint, from_yaml, load
from uav_collect.scenario.model import BatteryConfig, Scenario

ONE_WAY = 'must be one way of three: energy_budget_kj, battery_wh, or battery_mah and battery_v'
HOVER_MIN = {'dji_m30': 36, 'dji_m300': 48, 'dji_m600': 38, 'dji_mavic_3': 40}
OWN = '{mass_kg: 2, rotors: 4, rotor_radius_m: 0.2, fuselage_drag_area_m2: 0.015}'


def fleet_of(folder: Path, default: str, uavs: str = '[{speed_mps: 10}]') -> Scenario:
    """A scenario whose fleet extends that of paper_10x10."""
    path = folder / 'mine.yaml'
    path.write_text(f'extends: paper_10x10\nfleet:\n  default: {default}\n  uavs: {uavs}\n')
    return load(path)


def refusal_of(folder: Path, default: str, uavs: str = '[{speed_mps: 10}]') -> str:
    with pytest.raises(ConfigError) as refused:
        fleet_of(folder, default, uavs)
    return str(refused.value).replace(str(folder), '')


def hover_power_w(scenario: Scenario) -> float:
    it = scenario.uavs[0].propulsion
    return it.blade_profile_power_w + it.induced_power_w


@pytest.mark.parametrize('name', HOVER_MIN)
def test_a_shipped_craft_hovers_as_long_as_its_maker_says(tmp_path: Path, name: str) -> None:
    scenario = fleet_of(tmp_path, f'{{airframe: {name}, battery_wh: airframe}}')
    hover_min = scenario.uavs[0].energy_budget_j / hover_power_w(scenario) / 60
    assert hover_min == pytest.approx(HOVER_MIN[name], rel=0.005)


def test_every_shipped_craft_flies_on_less_power_at_some_speed_than_it_hovers_on() -> None:
    assert {*airframe_names()} == {'zeng_2019', *HOVER_MIN}
    for name in airframe_names():
        powers_w = [propulsion_power_w(v, *airframe_named(name).propulsion.values())
                    for v in (0.0, 10.0, 40.0)]  # fmt: skip
        assert powers_w[1] < powers_w[0] < powers_w[2]


def test_a_craft_that_is_to_fly_faster_than_it_can_is_refused_where_its_speed_stands(
    tmp_path: Path,
) -> None:
    named = '{airframe: dji_m600}'
    assert fleet_of(tmp_path, named, '[{speed_mps: 18}]').uavs[0].speed_mps == 18.0
    assert refusal_of(tmp_path, named, '[{speed_mps: 10}, {speed_mps: 18.5}]') == (
        '/mine.yaml:4: fleet.uavs.1.speed_mps is 18.5: must be at most 18 m/s, the most that its '
        'airframe flies'
    )
    own = '{airframe: {like: dji_m600, max_speed_mps: 25}}'
    assert fleet_of(tmp_path, own, '[{speed_mps: 18.5}]').uavs[0].speed_mps == 18.5


def test_the_source_s_craft_has_the_constants_of_the_paper() -> None:
    derived = airframe_named('zeng_2019').propulsion
    known = load('paper_10x10').uavs[0].propulsion.as_mapping()
    assert derived == pytest.approx(known, rel=1e-3)
    assert round(derived['blade_profile_power_w'], 2) == 79.86
    assert round(derived['induced_power_w'], 2) == 88.63


def test_a_loaded_scenario_stands_alone_with_constants_and_budget(tmp_path: Path) -> None:
    scenario = fleet_of(tmp_path, f'{{airframe: {OWN}, battery_mah: 5000, battery_v: 22}}')
    text = scenario.to_yaml()
    assert 'airframe' not in text
    assert 'battery_' not in text
    assert scenario.uavs[0].battery == BatteryConfig(nominal_v=22.0)
    assert fingerprint(from_yaml(text)) == fingerprint(scenario)
    assert scenario.uavs[0].energy_budget_j == pytest.approx(5.0 * 22 * 3600)


def test_a_share_of_the_battery_is_left_unused(tmp_path: Path) -> None:
    scenario = fleet_of(tmp_path, '{battery_wh: 100, battery_usable_share: 0.8}')
    assert scenario.uavs[0].energy_budget_kj == pytest.approx(288.0)


def test_a_loaded_uav_remembers_its_battery_which_no_mission_depends_on(tmp_path: Path) -> None:
    craft = fleet_of(tmp_path, '{airframe: dji_m300, battery_wh: 400, battery_usable_share: 0.7}')
    assert craft.uavs[0].battery == BatteryConfig(usable_share=0.7, nominal_v=46.2)
    again = tmp_path / 'again.yaml'
    again.write_text(craft.to_yaml())
    assert load(again) == craft
    budget_kj = craft.uavs[0].energy_budget_kj
    plain = fleet_of(tmp_path, f'{{airframe: dji_m300, energy_budget_kj: {budget_kj!r}}}')
    assert plain.uavs[0].battery is None
    assert fingerprint(plain) == fingerprint(craft)


def test_a_payload_makes_a_craft_that_is_like_another_heavier(tmp_path: Path) -> None:
    plain = fleet_of(tmp_path, '{airframe: dji_m30}')
    loaded = fleet_of(tmp_path, '{airframe: {like: dji_m30, mass_kg: 4.2}}')
    ratio = (4.2 / 3.77) ** 1.5  # induced power W^1.5; the tips turn faster by W^0.5
    assert hover_power_w(loaded) == pytest.approx(ratio * hover_power_w(plain))


def test_the_topmost_word_counts_of_two_ways_to_say_one_thing(tmp_path: Path) -> None:
    uavs = '[{speed_mps: 5}, {speed_mps: 6, battery_wh: 30}, {speed_mps: 7, energy_budget_kj: 50}]'
    first, second, third = fleet_of(tmp_path, '{battery_mah: 1000, battery_v: 20}', uavs).uavs
    assert first.energy_budget_kj == pytest.approx(72.0)
    assert second.energy_budget_kj == pytest.approx(108.0)
    assert third.energy_budget_kj == 50.0
    changed = load(tmp_path / 'mine.yaml', {'fleet.default.battery_wh': 10})
    assert changed.uavs[0].energy_budget_kj == pytest.approx(36.0)
    assert changed.uavs[1].energy_budget_kj == pytest.approx(108.0)


def test_own_constants_over_a_craft_of_the_fleet_count(tmp_path: Path) -> None:
    own = (
        '{blade_profile_power_w: 10, induced_power_w: 20, tip_speed_mps: 100,'
        ' induced_speed_mps: 4, parasite_coefficient: 0.01}'
    )
    uavs = f'[{{speed_mps: 5}}, {{speed_mps: 6, propulsion: {own}}}]'
    craft, constants = fleet_of(tmp_path, '{airframe: dji_m30}', uavs).uavs
    assert craft.propulsion.induced_power_w > 300
    assert constants.propulsion.induced_power_w == 20.0


@pytest.mark.parametrize(
    ('default', 'line'),
    [
        ('{airframe: m30}', "airframe is 'm30': must be a mapping, or one of zeng_2019, dji_m30"),
        ('{airframe: common}', "airframe is 'common': must be a mapping, or one of zeng_2019"),
        ('{airframe: 7}', 'airframe is 7: must be a mapping, or one of zeng_2019'),
        ('{airframe: {like: x}}', "airframe.like is 'x': must be a mapping, or one of zeng_2019"),
        ('{airframe: {mass_kg: 3}}', 'airframe.rotors is missing: must be a whole number from 1'),
        ('{airframe: {like: dji_m30, mass_kg: 0}}',
         'airframe.mass_kg is 0: must be a number from 0.01 to 1000 kg'),
        ('{airframe: {like: dji_m30, wings: 2}}', 'airframe.wings is an unknown key'),
        ('{airframe: {like: dji_m30, blades: 2}}',
         'airframe must say either solidity, or blades and chord_m'),
        ('{airframe: {like: dji_m30, tip_speed_mps: 90, lift_coefficient: 1}}',
         'airframe must say either tip_speed_mps or lift_coefficient'),
        ('{airframe: dji_m30, propulsion: {}}', 'airframe is given: must not be beside'),
        ('{battery_wh: 20, energy_budget_kj: 72}', f'battery_wh {ONE_WAY}'),
        ('{battery_wh: 20, battery_mah: 900, battery_v: 22}', f'battery_wh {ONE_WAY}'),
        ('{battery_wh: 20, battery_v: 22}', f'battery_wh {ONE_WAY}'),
        ('{battery_mah: 900}', f'battery_mah {ONE_WAY}'),
        ('{battery_wh: 20, battery: {nominal_v: 22}}', f'battery_wh {ONE_WAY}'),
        ('{battery_v: 22}', f'battery_v {ONE_WAY}'),
        ('{battery_usable_share: 0.8}', f'battery_usable_share {ONE_WAY}'),
        ('{battery_wh: 20, battery_usable_share: 80}',
         'battery_usable_share is 80: must be a number from 0.01 to 1'),
        ('{battery_wh: lots}', "battery_wh is 'lots': must be a number from 0.001 to 100000 Wh"),
        ('{battery_wh: airframe}', 'battery_wh is airframe: must be a number of Wh, as no'),
        ('{battery_wh: 0.1}', 'battery_wh is 0.36 kJ: must be more than energy_margin_kj, 1 kJ'),
    ],
)  # fmt: skip
def test_a_wrong_craft_or_battery_is_refused_by_its_line(
    tmp_path: Path, default: str, line: str
) -> None:
    assert refusal_of(tmp_path, default).startswith(f'/mine.yaml:3: fleet.default.{line}')


def test_all_problems_of_craft_and_batteries_come_at_once(tmp_path: Path) -> None:
    uavs = '[{speed_mps: 5, airframe: x}, {speed_mps: 6, battery_wh: -1}]'
    lines = refusal_of(tmp_path, '{}', uavs).splitlines()
    assert [line.partition(' is ')[0] for line in lines] == [
        '/mine.yaml:4: fleet.uavs.0.airframe',
        '/mine.yaml:4: fleet.uavs.1.battery_wh',
    ]
