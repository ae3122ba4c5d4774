"""Missions joined from reports are the rollout's, to the byte; or they are not there at all."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from reports import is_decision, joined, MissionSetup, reports_of, same
from tiny_world import tiny, uav
from uav_collect.errors import ConfigError, RefusedError
from uav_collect.ingest.join import DropReason, ReportOutcome
from uav_collect.ingest.reports import EventReport, FleetReport, MissionReport, TransitionReport
from uav_collect.missions.experience import Episode, Records
from uav_collect.uav.actions import FAILSAFE, HOME, NONE
from uav_collect.uav.observation import Layout
from uav_collect.world.reward import Reward

# Little energy: half a minute of flight.
FLEET = uav(5.0, energy_budget_kj=25.0), uav(10.0, energy_budget_kj=12.0)
SEEDS = range(7, 13)
THIRD_M = 100.0 / 3.0


def setup(**values: object) -> MissionSetup:
    return MissionSetup(**{'scenario': tiny(*FLEET), **values})  # type: ignore[arg-type]


def setup_of_odd_lengths() -> MissionSetup:
    """Places that no binary number gives exactly; sensors stand anywhere."""
    scenario = tiny(
        uav(7.3, energy_budget_kj=25.0, home_m=(31.7, 12.9)),
        uav(11.9, energy_budget_kj=15.0),
        area__cell_size_m=THIRD_M,
        sensors=[(41.3, 20.7, 0.3), (88.1, 70.9, 0.7)],
        reward__discount_per_s=0.993,
    )
    return MissionSetup(scenario=scenario)


def events_and_decisions(reports: Sequence[FleetReport]) -> list[FleetReport]:
    return [report for report in reports if not isinstance(report, MissionReport)]


def changed(report: FleetReport, **changes: object) -> FleetReport:
    return replace(report, **changes)  # type: ignore


def needed(reports: Sequence[FleetReport]) -> int:
    return sum(isinstance(report, EventReport) or is_decision(report) for report in reports)


@pytest.mark.parametrize(
    'flown',
    [
        setup(),
        setup(layout=Layout.PAPER, reward=Reward.PAPER, discount_per_s=0.99),
        setup(layout=Layout.PAPER, discount_per_s=1.0),
        setup(max_decisions=9),
        setup_of_odd_lengths(),
        replace(setup_of_odd_lengths(), reward=Reward.PAPER, discount_per_s=0.993),
    ],
)
def test_missions_joined_from_messages_are_the_rollouts_to_the_byte(flown: MissionSetup) -> None:
    found = joined(flown.joiner(), reports_of(flown, SEEDS))
    pairs = zip(found, flown.episodes(SEEDS), strict=True)
    assert [same(one.episode, other) for one, other in pairs] == [[] for _ in SEEDS]


def test_a_mission_that_is_cut_off_ends_with_the_decision_it_waits_for() -> None:
    flown = setup(max_decisions=9)
    joiner, reports = flown.joiner(), reports_of(flown, SEEDS)
    for one in joined(joiner, reports):
        assert (one.episode.n_decisions, one.episode.is_whole) == (10, False)
    # What comes after the cut is known to be of no use.
    counts = joiner.counts.reports
    assert counts[ReportOutcome.LATE] == counts[ReportOutcome.DROPPED] == 0
    assert counts.total() == len(events_and_decisions(reports))


def test_a_mission_that_the_world_gave_up_is_cut_off_there() -> None:
    flown = setup()
    reports = [reports_of(flown, [seed]) for seed in SEEDS]
    for each in reports:
        last = [at for at, it in enumerate(each) if isinstance(it, EventReport)][7]
        del each[last + 1 : -1]
        n_decisions = sum(is_decision(it) for it in each)
        each[-1] = changed(each[-1], cut_after=n_decisions)
    whole = flown.episodes(SEEDS)
    for order in (1, -1):
        ordered = [it for each in reports for it in each[::order]]
        found = joined(flown.joiner(), ordered)
        for one, other in zip(found, whole, strict=True):
            n_kept = one.episode.n_decisions
            assert (n_kept, one.episode.is_whole) == (8, False)
            kept = Records(*(table[:n_kept] for table in other.records))
            kept.action[-1], kept.reward[-1], kept.duration_s[-1] = NONE, 0.0, 0.0
            assert same(one.episode, replace(other, records=kept, is_whole=False)) == []


def test_the_efficiency_of_a_mission_is_its_logs() -> None:
    flown = setup()
    reports = reports_of(flown, SEEDS)
    for one in joined(flown.joiner(), reports):
        events = [
            it for it in reports if isinstance(it, EventReport) and it.mission_id == one.mission_id
        ]
        efficiency = sum(it.collected_bit for it in events) / sum(it.energy_j for it in events)
        assert one.efficiency_kbit_per_j == pytest.approx(efficiency / 1e3)


def test_any_order_of_a_missions_messages_gives_the_same_mission() -> None:
    flown = setup()
    reports = [reports_of(flown, [seed]) for seed in SEEDS]
    rng = np.random.default_rng(0)
    mixed = [each[place] for each in reports for place in rng.permutation(len(each))]
    # The very last message may not be needed, as the second one about the mission.
    found = joined(flown.joiner(), mixed)
    expected = flown.episodes(SEEDS)
    assert [one.mission_id for one in found] == [f'world-{seed}' for seed in SEEDS]
    assert all(not same(one.episode, other) for one, other in zip(found, expected, strict=True))


def test_messages_that_come_twice_are_counted_and_change_nothing() -> None:
    flown = setup()
    joiner, reports = flown.joiner(), reports_of(flown, SEEDS)
    found = joined(joiner, [report for report in reports for _ in range(2)])
    expected = flown.episodes(SEEDS)
    assert all(not same(one.episode, other) for one, other in zip(found, expected, strict=True))
    n_home = sum(isinstance(it, TransitionReport) and it.action == HOME for it in reports)
    assert joiner.counts.reports == {
        ReportOutcome.USED: needed(reports),
        ReportOutcome.DUPLICATE: needed(reports),
        ReportOutcome.UNNEEDED: 2 * n_home,
    }


@pytest.mark.parametrize(
    ('kind', 'changes'),
    [
        (EventReport, {'collected_bit': 1.0}),
        (TransitionReport, {'energy_left_j': 1.0}),
        (MissionReport, {'mission_seed': 8}),
    ],
)
def test_a_mission_that_is_reported_in_two_ways_is_dropped(
    kind: type[FleetReport], changes: dict[str, object]
) -> None:
    flown = setup()
    joiner, reports = flown.joiner(), reports_of(flown, [7])
    place = next(at for at, it in enumerate(reports) if isinstance(it, kind))
    reports.insert(place + 1, changed(reports[place], **changes))
    refusals: list[str] = []
    assert joined(joiner, reports, refusals.append) == []
    assert refusals[0].endswith('is told in two ways')
    assert joiner.counts.dropped == {DropReason.REFUSED: 1}
    assert joiner.counts.reports.total() == len(events_and_decisions(reports))


@pytest.mark.parametrize('kind', [EventReport, TransitionReport])
def test_a_mission_that_lacks_a_message_is_dropped_whole_once_later_ones_were_joined(
    kind: type[FleetReport],
) -> None:
    flown = setup()
    first, later = reports_of(flown, [7]), reports_of(flown, range(20, 29))
    place = max(
        at
        for at, it in enumerate(first)
        if isinstance(it, kind) and (kind is EventReport or is_decision(it))
    )
    lost = first.pop(place)
    joiner = flown.joiner()
    found = joined(joiner, [*first, *later])
    assert [one.mission_id for one in found] == [f'world-{seed}' for seed in range(20, 29)]
    assert joiner.counts.dropped == {DropReason.MISSING: 1}
    assert joiner.n_waiting == 0
    assert joiner.counts.reports[ReportOutcome.DROPPED] == needed(first)
    assert joined(joiner, [lost]) == []  # too late, and no ghost of a mission
    assert joiner.counts.reports[ReportOutcome.LATE] == 1
    assert joiner.n_waiting == 0


def test_a_mission_waits_for_a_late_message_while_others_are_joined() -> None:
    flown = setup()
    first, later = reports_of(flown, [7]), reports_of(flown, range(20, 27))
    late = first.pop(3)
    found = joined(flown.joiner(), [*first, *later, late])
    assert found[-1].mission_id == 'world-7'
    assert not same(found[-1].episode, flown.episodes([7])[0])


def test_the_report_at_the_end_of_a_mission_makes_up_for_that_at_its_start() -> None:
    flown = setup()
    found = joined(flown.joiner(), reports_of(flown, [7])[1:])
    assert not same(found[0].episode, flown.episodes([7])[0])


def test_what_still_waits_is_dropped_when_no_more_will_come() -> None:
    flown = setup()
    joiner, reports = flown.joiner(), reports_of(flown, [7])
    joined(joiner, reports[:-4])
    joiner.drop_incomplete()
    assert joiner.counts.dropped == {DropReason.MISSING: 1}
    assert joiner.n_waiting == 0


def test_the_messages_that_wait_are_bounded() -> None:
    # Each mission lacks its first event: nothing is ever joined.
    flown = setup()
    joiner = flown.joiner(max_reports=300)
    for seed in range(20):
        assert joined(joiner, reports_of(flown, [seed])[3:]) == []
        assert joiner.n_waiting <= 300
    assert joiner.counts.dropped[DropReason.MISSING] > 5


def test_missions_that_were_joined_before_are_not_joined_again() -> None:
    flown = setup()
    joiner = flown.joiner(known_ids=['world-7'])
    assert [it.mission_id for it in joined(joiner, reports_of(flown, [7, 8]))] == ['world-8']
    assert joiner.counts.dropped == {}


def test_a_mission_that_a_failsafe_ended_is_dropped() -> None:
    flown = setup()
    joiner, reports = flown.joiner(), reports_of(flown, [7, 8])
    place = next(
        at for at, it in enumerate(reports) if isinstance(it, EventReport) and it.action == HOME
    )
    reports[place] = changed(reports[place], reason=FAILSAFE)
    assert [it.mission_id for it in joined(joiner, reports)] == ['world-8']
    assert joiner.counts.dropped == {DropReason.FAILSAFE: 1}
    assert joiner.counts.reports[ReportOutcome.LATE] == 0


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
    flown = setup()
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
    flown = setup()
    joiner, reports = flown.joiner(), reports_of(flown, [7])
    place = next(at for at, it in enumerate(reports) if isinstance(it, kind))
    with pytest.raises(RefusedError, match=words):
        joined(joiner, [changed(reports[place], **changes)])
    assert joiner.counts.dropped == {DropReason.REFUSED: 1}


def test_the_scenarios_reward_is_refused_under_another_discount() -> None:
    with pytest.raises(ConfigError, match=r'discount_per_s is 0\.997: must be 0\.99'):
        setup(reward=Reward.PAPER, discount_per_s=0.997).joiner()


def relayed(reports: Sequence[FleetReport], rng: np.random.Generator) -> list[FleetReport]:
    """A channel that drops 5 %, doubles 10 % and holds 10 % back behind up to 200 others."""
    arrivals: list[tuple[float, int, FleetReport]] = []
    for place, report in enumerate(reports):
        if rng.random() < 0.05:
            continue
        for _ in range(2 if rng.random() < 0.1 else 1):
            delay = rng.uniform(0.0, 200.0) if rng.random() < 0.1 else 0.0
            arrivals.append((place + delay, len(arrivals), report))
    return [report for _, _, report in sorted(arrivals, key=lambda it: it[:2])]


@pytest.fixture(scope='module')
def short_missions() -> tuple[MissionSetup, list[FleetReport], list[Episode]]:
    """500 of them, and what the rollout records of them."""
    fleet = uav(5.0, energy_budget_kj=9.0), uav(10.0, energy_budget_kj=5.0)
    flown = MissionSetup(scenario=tiny(*fleet), layout=Layout.PAPER, max_decisions=9)
    return flown, reports_of(flown, range(500)), flown.episodes(range(500))


def test_over_a_channel_that_loses_doubles_and_mixes_no_mission_is_wrong(
    short_missions: tuple[MissionSetup, list[FleetReport], list[Episode]],
) -> None:
    flown, reports, expected = short_missions
    arrived = relayed(reports, np.random.default_rng(3))
    joiner = flown.joiner()
    found = joined(joiner, arrived)
    joiner.drop_incomplete()
    assert all(not same(it.episode, expected[it.episode.mission_seed]) for it in found)
    assert len({it.mission_id for it in found}) == len(found)
    counts = joiner.counts
    assert counts.n_joined == len(found) > 100
    reported = {it.mission_id for it in events_and_decisions(arrived)}
    assert counts.n_joined + counts.dropped[DropReason.MISSING] == len(reported)
    assert counts.reports.total() == len(events_and_decisions(arrived))


def test_without_faults_nothing_is_lost(
    short_missions: tuple[MissionSetup, list[FleetReport], list[Episode]],
) -> None:
    flown, reports, _ = short_missions
    joiner = flown.joiner()
    assert len(joined(joiner, reports)) == 500
    assert {*joiner.counts.reports} == {ReportOutcome.USED, ReportOutcome.UNNEEDED}
    assert joiner.counts.dropped == {}
    assert joiner.n_waiting == 0
