"""Missions flown by processes over ROS leave, to the byte, the logs of those flown in process."""

from pathlib import Path

from fleets import Fleet, logs, scenario_of
from processes import Processes, RunningProcess
import pytest
from uav_collect.recording.bag_reader import read_missions

pytestmark = [pytest.mark.ros, pytest.mark.long]

SEEDS = range(2)
FEW = range(7, 9)
ALL = {1, 2, 3, 4}

# Messages are lost, late and too many; a UAV goes, another falls silent, a third is slow.
ROUGH: dict[str, object] = {
    'radio__loss_share': 0.3,
    'radio__delay_s': [6.0, 5.0],
    'radio__rate_bps': 400.0,
    'radio__beacon_period_s': 3.0,
    'faults': [
        {'uav': 4, 'kind': 'gone', 'at_s': [10, 60]},
        {'uav': 2, 'kind': 'silent', 'at_decision': [5, 30]},
        {'uav': 1, 'kind': 'slow', 'at_s': [0, 50]},
    ],
}

# An area that is no square, within a boundary and around a closed cell; empty cells are known.
FIELD: dict[str, object] = {
    'area__rows': 6,
    'area__columns': 9,
    'area__boundary': [[0, 0], [450, 0], [450, 160], [280, 300], [0, 300]],
    'area__no_fly': [[[60, 60], [140, 60], [140, 90]]],
    'demand__known_empty': 'sensors',
}


def start(
    fleet: Fleet, late: set[int], policy: str, allocator: str, **world: object
) -> RunningProcess:
    """Start the world while some agents run already, the late ones once it waits for them."""
    uavs = set(range(1, fleet.scenario.n_uavs + 1))
    for uav in sorted(uavs - late):
        fleet.start_agent(uav, policy, allocator)
    process = fleet.start_world(**world)
    for uav in sorted(uavs & late):
        process.wait_for(f'waiting for .*UAV {uav}\\b' if uav == min(late) else r'joined')
        fleet.start_agent(uav, policy, allocator)
    return process


@pytest.mark.parametrize(
    ('n_uavs', 'policy', 'late'),
    [
        (1, 'hert', {1}),
        (1, 'sweep', set()),
        (2, 'hert', {2}),
        (2, 'sweep', {1, 2}),
        (3, 'hert', set()),
        (4, 'sweep', {1, 3}),
    ],
)
def test_a_row_of_missions_over_ros_equals_the_same_missions_in_one_process(
    n_uavs: int, policy: str, late: set[int], processes: Processes, tmp_path: Path
) -> None:
    fleet = Fleet(processes=processes, scenario=scenario_of(n_uavs), folder=tmp_path / 'run')
    world = start(fleet, late, policy, 'exact', missions=len(SEEDS), viewer_rate_hz=0.0)
    expected = logs(fleet.scenario, SEEDS, policy)
    assert world.wait_for_exit() == 0
    assert fleet.logs(SEEDS) == expected


@pytest.mark.parametrize(
    ('n_uavs', 'policy', 'allocator', 'overrides'),
    [
        (2, 'sweep', 'equal', {}),
        (2, 'sweep', 'exact', {'radio__n_antennas': 2, 'radio__csi_error_variance': 0.1}),
        (2, 'hert-equal', 'exact', {'fleet__default__energy_budget_kj': 60.0}),
        (3, 'sweep', 'exact', {'radio__contact_range_m': float('inf')}),
        (3, 'random', 'exact', {'fleet__default__energy_budget_kj': 60.0}),
        pytest.param(
            *(2, 'lookahead:sweep:2', 'exact', {'area__cells_per_side': 3}),
            marks=pytest.mark.nightly,
        ),
        (4, 'sweep', 'exact', ROUGH),
        (2, 'sweep', 'exact', FIELD),
    ],
    ids=[
        'equal bandwidth',
        'imperfect CSI',
        'small budget',
        'in contact',
        'random',
        'looking ahead',
        'rough',
        'field',
    ],
)
def test_missions_of_another_kind_are_equal_too(
    n_uavs: int,
    policy: str,
    allocator: str,
    overrides: dict[str, object],
    processes: Processes,
    tmp_path: Path,
) -> None:
    scenario = scenario_of(n_uavs, **overrides)
    fleet = Fleet(processes=processes, scenario=scenario, folder=tmp_path / 'run')
    world = start(fleet, set(), policy, allocator, seed=FEW[0], missions=len(FEW))
    expected = logs(scenario, FEW, policy, allocator)
    assert world.wait_for_exit() == 0
    assert fleet.logs(FEW) == expected


def test_a_bag_holds_the_log_of_each_mission_to_the_byte(
    processes: Processes, tmp_path: Path
) -> None:
    fleet = Fleet(processes=processes, scenario=scenario_of(2), folder=tmp_path / 'run')
    recorder = fleet.start_recorder(stop_after_missions=len(FEW))
    world = start(fleet, ALL, 'sweep', 'exact', seed=FEW[0], missions=len(FEW))
    assert world.wait_for_exit() == 0
    assert recorder.wait_for_exit() == 0
    missions = read_missions(fleet.bag)
    assert all(mission.is_complete for mission in missions)
    assert [mission.log.to_jsonl() for mission in missions] == fleet.logs(FEW)
    assert fleet.logs(FEW) == logs(fleet.scenario, FEW)
