"""A report that does not match is refused: which one, what of it, its value, what it must be."""

import numpy as np
import pytest
from reports import changed, events_and_decisions, is_decision, joined, MissionSetup, reports_of
from tiny_world import tiny, uav
from uav_collect.errors import RefusedError
from uav_collect.ingest.join import DropReason
from uav_collect.ingest.reports import (
    EventReport,
    FleetReport,
    MissionReport,
    TransitionReport,
)

# Little energy: half a minute of flight.
FLEET = uav(5.0, energy_budget_kj=25.0), uav(10.0, energy_budget_kj=12.0)
SETUP = MissionSetup(scenario=tiny(*FLEET))


def changed_float32(content: bytes, place: int, value: float) -> bytes:
    values = np.frombuffer(content, dtype='<f4').copy()
    values[place] = value
    return values.tobytes()


@pytest.mark.parametrize(
    ('changes', 'words'),
    [
        ({'layout': 'egocentric/1'}, "layout is 'egocentric/1': must be 'egocentric/2'"),
        ({'scenario_fingerprint': 'beef'}, "scenario_fingerprint is 'beef': must be '"),
        ({'observation': bytes(8)}, r'observation has 8 bytes: must be \d+'),
        ({'observation': (12, np.nan)}, r'observation\[12\] is nan: must be finite'),
        ({'observation': (12, 3.0)}, r'observation\[12\] is 3: what it was encoded from gives'),
        ({'energy_left_j': np.inf}, 'energy_left_j is inf: must be finite'),
        ({'time_s': np.nan}, 'time_s is nan: must be finite'),
        ({'uav': 2}, 'uav is 3: must be 1 to 2'),
        ({'cell': 16}, 'cell is 16: must be 0 to 15'),
        ({'action': 6}, 'action is 6: must be 0 to 5'),
        ({'legal': 0}, r'action is \d: must be legal'),
        ({'previous_action': 5}, 'previous_action is 5: must be -1 to 4'),
        ({'complete': bytes(3)}, 'complete has 3 bytes: must be 2'),
        ({'seen': b''}, 'seen has 0 bytes: must be 2'),
        ({'peer_s': bytes(8)}, 'peer_s has 8 bytes: must be 16'),
        ({'peer_x_m': np.array([0.0, np.nan]).tobytes()}, r'peer_x_m\[1\] is nan'),
        ({'seen': bytes(2)}, r'observation\[\d+\] is [\d.]+: what it was encoded from gives 0'),
        ({'complete': b'\xff\xff'}, 'complete is ffff: the world has '),
        ({'decision': 9}, 'decision is 9: the world has '),
        ({'time_s': 1e3}, 'time_s is 1000.0: the world has '),
        ({'energy_left_j': 1.0}, 'energy_left_j is 1.0: the world has '),
    ],
)  # fmt: skip
def test_a_transition_that_does_not_match_is_refused_and_named(
    changes: dict[str, object], words: str
) -> None:
    flown = SETUP
    joiner, reports = flown.joiner(), reports_of(flown, [7, 8])
    place = next(at for at, it in enumerate(reports) if is_decision(it))
    report = reports[place]
    assert isinstance(report, TransitionReport)
    if isinstance(changes.get('observation'), tuple):
        changes = {'observation': changed_float32(report.observation, *changes['observation'])}  # type: ignore[misc]
    reports[place] = changed(report, **changes)
    refusals: list[str] = []
    assert [it.mission_id for it in joined(joiner, reports, refusals.append)] == ['world-8']
    assert len(refusals) == 1
    with pytest.raises(RefusedError, match=words):
        raise RefusedError(refusals[0])
    assert refusals[0].startswith(f'mission world-7, event {report.event}, transition of UAV ')
    assert joiner.counts.dropped == {DropReason.REFUSED: 1}
    assert joiner.counts.reports.total() == len(events_and_decisions(reports))


@pytest.mark.parametrize(
    ('kind', 'changes', 'words'),
    [
        (MissionReport, {'scenario_fingerprint': 'beef'}, "scenario_fingerprint is 'beef'"),
        (MissionReport, {'demand_bit': bytes(8)}, 'demand_bit has 8 bytes: must be 24'),
        (EventReport, {'uav': 5}, 'uav is 6: must be 1 to 2'),
        (EventReport, {'action': -1}, 'action is -1: must be 0 to 5'),
        (EventReport, {'reward': np.nan}, 'reward is nan: must be finite'),
        (EventReport, {'uav_phase': b'0'}, 'uav_phase has 1 bytes: must be 2'),
        (EventReport, {'uav_complete': bytes(3)}, 'uav_complete has 3 bytes: must be 4'),
        (EventReport, {'true_complete': bytes(3)}, 'true_complete has 3 bytes: must be 2'),
        (EventReport, {'uav_x_m': np.array([np.inf, 0.0]).tobytes()}, r'uav_x_m\[0\] is inf'),
    ],
)
def test_what_the_world_reports_is_refused_and_named_alike(
    kind: type[FleetReport], changes: dict[str, object], words: str
) -> None:
    flown = SETUP
    joiner, reports = flown.joiner(), reports_of(flown, [7])
    place = next(at for at, it in enumerate(reports) if isinstance(it, kind))
    with pytest.raises(RefusedError, match=words):
        joined(joiner, [changed(reports[place], **changes)])
    assert joiner.counts.dropped == {DropReason.REFUSED: 1}
