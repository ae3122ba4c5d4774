"""What is read from a recording, and what is said of one that cannot be read."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from bags import ABORTED, ENDED, HandMadeBag, STARTED
import numpy as np
import pytest
from tiny_world import tiny, uav
from uav_collect.errors import BagError, RecordingError
from uav_collect.missions.rollout import fly
from uav_collect.recording.bag_reader import read_missions, read_recording, RecordedMission
from uav_collect.recording.mission_log import MissionLog
from uav_collect.scenario.load import load
from uav_collect.scenario.model import Scenario
from uav_collect.scenario.site import build_site, Site


@pytest.fixture(scope='module')
def paper() -> Scenario:
    return load('paper_8x8')


@pytest.fixture(scope='module')
def site(paper: Scenario) -> Site:
    return build_site(paper)


@pytest.fixture(scope='module')
def flown(site: Site) -> list[MissionLog]:
    return fly(site, [3, 4], 'sweep')


def record(folder: Path, site: Site, log: MissionLog, **mission: object) -> Path:
    bag = HandMadeBag(folder)
    bag.add_scenario(site)
    bag.add_mission(log, 'first', **mission)  # type: ignore[arg-type]
    bag.writer.close()
    return folder


def read_one(folder: Path) -> RecordedMission:
    (mission,) = read_missions(folder)
    return mission


def test_the_log_in_a_bag_is_the_log_that_was_flown_to_the_byte(
    tmp_path: Path, site: Site, flown: list[MissionLog]
) -> None:
    mission = read_one(record(tmp_path / 'bag', site, flown[0]))
    assert mission.log.to_jsonl() == flown[0].to_jsonl()
    assert mission.is_complete


def test_bytes_that_are_no_message_are_passed_over(
    tmp_path: Path, site: Site, flown: list[MissionLog]
) -> None:
    bag = HandMadeBag(tmp_path / 'bag')
    bag.add_scenario(site)
    bag.add_mission(flown[0], 'first')
    for topic in ('/world/scenario', '/world/mission', '/world/epoch'):
        for content in (b'\0\1\0\0', b'\0\1\0\0' + b'\xff' * 300):
            bag.add_bytes(topic, content)
    bag.writer.close()
    mission = read_one(tmp_path / 'bag')
    assert mission.log.to_jsonl() == flown[0].to_jsonl()
    assert mission.is_complete


def test_an_event_that_is_recorded_twice_with_different_values_is_left_out(
    tmp_path: Path, site: Site, flown: list[MissionLog]
) -> None:
    bag = HandMadeBag(tmp_path / 'bag')
    bag.add_scenario(site)
    bag.add_mission(flown[0], 'first')
    bag.add('/world/epoch', 'Epoch', mission_id='first', event=3, uav=1)
    bag.writer.close()
    [mission] = (recording := read_recording(tmp_path / 'bag')).missions
    [damage] = recording.damages
    assert damage.endswith('first: event 3, left out: is recorded twice with different values')
    assert len(mission.log.events) == len(flown[0].events) - 1
    assert not mission.is_complete


def test_every_bit_of_heard_survives_a_fleet_of_64(tmp_path: Path) -> None:
    site = build_site(tiny(*[uav() for _ in range(64)]))
    (log,) = fly(site, [0], 'sweep')
    assert (log.events['heard'] >= 2**63).any()
    mission = read_one(record(tmp_path / 'bag', site, log))
    assert mission.log.to_jsonl() == log.to_jsonl()


def test_scenario_site_and_demand_come_from_the_bag_alone(
    tmp_path: Path, paper: Scenario, site: Site, flown: list[MissionLog]
) -> None:
    demand_bit = np.linspace(0.0, 1e6, site.n_sensors)
    mission = read_one(record(tmp_path / 'bag', site, flown[0], demand_bit=demand_bit))
    assert mission.site.scenario == paper
    assert mission.site.sensor_ids == site.sensor_ids
    np.testing.assert_array_equal(mission.site.position_m, site.position_m)
    np.testing.assert_array_equal(mission.demand_bit, demand_bit)


def test_radio_messages_are_counted_for_each_mission(
    tmp_path: Path, site: Site, flown: list[MissionLog]
) -> None:
    bag = HandMadeBag(tmp_path / 'bag')
    bag.add_scenario(site)
    bag.add_mission(flown[0], 'first', n_radio_messages=3)
    bag.add_mission(flown[1], 'second', n_radio_messages=5)
    bag.writer.close()
    assert [m.n_radio_messages for m in read_missions(tmp_path / 'bag')] == [3, 5]


def test_missions_come_in_the_order_they_were_flown(
    tmp_path: Path, site: Site, flown: list[MissionLog]
) -> None:
    bag = HandMadeBag(tmp_path / 'bag')
    bag.add_scenario(site)
    bag.add_mission(flown[1], 'z')
    bag.add_mission(flown[0], 'a')
    bag.writer.close()
    seeds = [m.log.header.mission_seed for m in read_missions(tmp_path / 'bag')]
    assert seeds == [4, 3]


@pytest.mark.parametrize('later', ['another', 'first'])
def test_each_mission_has_the_scenario_that_its_world_had(
    tmp_path: Path, paper: Scenario, site: Site, flown: list[MissionLog], later: str
) -> None:
    other = build_site(tiny())
    (log,) = fly(other, [0], 'sweep')
    bag = HandMadeBag(tmp_path / 'bag')
    bag.add_scenario(site, world='first')
    bag.add_mission(flown[0], 'first', world='first')
    bag.add_scenario(other, world=later)
    bag.add_mission(log, 'second', world=later)
    bag.writer.close()
    assert [m.site.scenario.name for m in read_missions(tmp_path / 'bag')] == [paper.name, 'tiny']


@pytest.mark.parametrize('missed', [[0], [5], [0, 1, 2]])
def test_a_mission_with_a_missed_event_is_incomplete(
    tmp_path: Path, site: Site, flown: list[MissionLog], missed: list[int]
) -> None:
    mission = read_one(record(tmp_path / 'bag', site, flown[0], leave_out=missed))
    assert not mission.is_complete
    assert len(mission.log.events) == len(flown[0].events) - len(missed)


def test_a_mission_without_its_last_event_is_incomplete(
    tmp_path: Path, site: Site, flown: list[MissionLog]
) -> None:
    last = len(flown[0].events) - 1
    mission = read_one(record(tmp_path / 'bag', site, flown[0], leave_out=[last]))
    assert not mission.is_complete


@pytest.mark.parametrize('phases', [[STARTED], [STARTED, ABORTED]])
def test_a_mission_that_did_not_end_is_incomplete(
    tmp_path: Path, site: Site, flown: list[MissionLog], phases: list[int]
) -> None:
    mission = read_one(record(tmp_path / 'bag', site, flown[0], phases=phases))
    assert not mission.is_complete


@pytest.mark.parametrize(('n_lacking', 'given_up'), [(0, 'the world was stopped'), (1, None)])
def test_a_mission_that_its_world_gave_up_says_why_if_all_decisions_are_there(
    tmp_path: Path, site: Site, flown: list[MissionLog], n_lacking: int, given_up: str | None
) -> None:
    bag = HandMadeBag(tmp_path / 'bag')
    bag.add_scenario(site)
    cut_off = replace(flown[0], events=flown[0].events[:5])
    bag.add_mission(cut_off, 'first', phases=[STARTED])
    figures = {'n_decisions': 5 + n_lacking, 'note': 'the world was stopped'}
    bag.add('/world/mission', 'Mission', mission_id='first', phase=ABORTED, **figures)
    bag.writer.close()
    mission = read_one(tmp_path / 'bag')
    assert (mission.is_complete, mission.given_up) == (False, given_up)


def test_a_mission_whose_start_was_missed_is_known_by_its_end(
    tmp_path: Path, site: Site, flown: list[MissionLog]
) -> None:
    mission = read_one(record(tmp_path / 'bag', site, flown[0], phases=[ENDED]))
    assert mission.is_complete
    assert mission.log.to_jsonl() == flown[0].to_jsonl()


def test_a_missing_bag_is_named(tmp_path: Path) -> None:
    with pytest.raises(BagError, match='nowhere: no such bag'):
        read_missions(tmp_path / 'nowhere')


def test_a_folder_without_a_bag_is_named(tmp_path: Path) -> None:
    with pytest.raises(BagError, match='not a bag'):
        read_missions(tmp_path)


@pytest.mark.parametrize('inside', ['', 'bag.mcap'])
def test_a_bag_without_metadata_is_read_by_its_folder_or_its_file(
    tmp_path: Path, site: Site, flown: list[MissionLog], inside: str
) -> None:
    folder = record(tmp_path / 'bag', site, flown[0])
    (folder / 'metadata.yaml').unlink()
    mission = read_one(folder / inside)
    assert mission.is_complete
    assert mission.log.to_jsonl() == flown[0].to_jsonl()


@pytest.mark.parametrize('read', [read_missions, read_recording])
def test_a_bag_whose_file_is_torn_says_how_to_repair_it(
    read: Callable[[Path], object], tmp_path: Path, site: Site, flown: list[MissionLog]
) -> None:
    folder = record(tmp_path / 'bag', site, flown[0])
    with (folder / 'bag.mcap').open('r+b') as file:
        file.truncate(2000)
    with pytest.raises(BagError, match=f'ends without a footer.*recorder --repair {folder}'):
        read(folder)


def test_a_bag_without_a_mission_says_so(tmp_path: Path, site: Site) -> None:
    bag = HandMadeBag(tmp_path / 'bag')
    bag.add_scenario(site)
    bag.writer.close()
    with pytest.raises(BagError, match='holds no mission'):
        read_missions(tmp_path / 'bag')


def test_a_bag_without_any_message_holds_no_mission(tmp_path: Path) -> None:
    HandMadeBag(tmp_path / 'bag').writer.close()
    with pytest.raises(BagError, match='holds no mission'):
        read_missions(tmp_path / 'bag')


def test_a_mission_whose_scenario_was_missed_is_named(
    tmp_path: Path, flown: list[MissionLog]
) -> None:
    bag = HandMadeBag(tmp_path / 'bag')
    bag.add_mission(flown[0], 'first')
    bag.writer.close()
    with pytest.raises(BagError, match='mission first: its scenario was not recorded'):
        read_missions(tmp_path / 'bag')


def test_sensors_other_than_the_scenario_draws_are_refused(
    tmp_path: Path, paper: Scenario, flown: list[MissionLog]
) -> None:
    elsewhere = build_site(load('paper_8x8', {'sensors.seed': 99}))
    site = replace(elsewhere, scenario=paper)
    folder = record(tmp_path / 'bag', site, flown[0])
    with pytest.raises(BagError, match='sensors are not those'):
        read_missions(folder)


def test_an_existing_folder_is_never_written_to(tmp_path: Path) -> None:
    (tmp_path / 'bag').mkdir()
    with pytest.raises(RecordingError, match='bag exists already'):
        HandMadeBag(tmp_path / 'bag')


def test_a_scenario_that_is_none_here_disturbs_no_other_mission(
    tmp_path: Path, site: Site, flown: list[MissionLog]
) -> None:
    bag = HandMadeBag(tmp_path / 'bag')
    bag.add('/world/scenario', 'Scenario', world_instance='other', yaml='area: 3\n')
    bag.add('/world/scenario', 'Scenario', world_instance='world', yaml='area: 3\n')
    bag.add_scenario(site)
    bag.add_mission(flown[0], 'first')
    bag.writer.close()
    assert read_one(tmp_path / 'bag').log.to_jsonl() == flown[0].to_jsonl()
