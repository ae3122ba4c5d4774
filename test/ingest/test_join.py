"""Missions joined from reports are the rollout's, to the byte; or they are not there at all."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from random_policies import header, random_policy
from reports import (
    changed,
    events_and_decisions,
    is_decision,
    joined,
    MissionSetup,
    reports_of,
    same,
)
from tiny_world import tiny, uav
from uav_collect.errors import ConfigError
from uav_collect.ingest.join import DropReason, ReportOutcome
from uav_collect.ingest.mission_ids import MissionIds
from uav_collect.ingest.reports import EventReport, FleetReport, MissionReport, TransitionReport
from uav_collect.missions.experience import Episode, Records
from uav_collect.scenario.model import Scenario
from uav_collect.uav.action_codes import FAILSAFE, HOME, NONE
from uav_collect.uav.observation import Layout
from uav_collect.uav.policy_network import FrozenPolicy
from uav_collect.world.reward import Reward

pytestmark = pytest.mark.long

# Little energy: half a minute of flight.
FLEET = uav(5.0, energy_budget_kj=25.0), uav(10.0, energy_budget_kj=12.0)
SEEDS = range(7, 13)
THIRD_M = 100.0 / 3.0

# Messages are lost and late, and each UAV has a fault now and then.
ROUGH: dict[str, object] = {
    'radio__loss_share': 0.3,
    'radio__delay_s': [4.0, 3.0],
    'radio__beacon_period_s': 2.5,
    'faults': [
        {'uav': 'any', 'kind': 'gone', 'at_decision': [0, 3], 'share': 0.5},
        {'uav': 'any', 'kind': 'slow', 'at_s': [0.0, 10.0]},
        {'uav': 'any', 'kind': 'silent', 'at_s': [0.0, 20.0], 'share': 0.5},
    ],
}

# No square, a closed cell in the way, and nobody has to look where no sensor is.
FIELD: dict[str, object] = {
    'area__rows': 4,
    'area__columns': 6,
    'area__boundary': [[0.0, 0.0], [300.0, 0.0], [300.0, 90.0], [200.0, 200.0], [0.0, 200.0]],
    'area__no_fly': [[[60.0, 60.0], [90.0, 60.0], [90.0, 90.0]]],
    'demand__known_empty': 'sensors',
    'radio__contact_range_m': 60.0,
}


def mission_setup(**values: object) -> MissionSetup:
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


def deaf() -> Scenario:
    """UAVs that hear nothing: the sweep turns home early."""
    ends = {'home': {'cell': [3, 2]}}
    return tiny(*({**each, **ends} for each in FLEET), radio__contact_range_m=0.0)


def follower() -> FrozenPolicy:
    """A policy that always takes the sweep's advice, unless it explores."""
    return random_policy(header(Layout.RELATIVE, side=4, advice_bonus=1e6))


def needed(reports: Sequence[FleetReport]) -> int:
    return sum(isinstance(report, EventReport) or is_decision(report) for report in reports)


@pytest.mark.parametrize(
    'flown',
    [
        mission_setup(),
        mission_setup(layout=Layout.PAPER, reward=Reward.PAPER, discount_per_s=0.99),
        mission_setup(layout=Layout.PAPER, discount_per_s=1.0),
        mission_setup(max_decisions=9),
        setup_of_odd_lengths(),
        replace(setup_of_odd_lengths(), reward=Reward.PAPER, discount_per_s=0.993),
        mission_setup(scenario=tiny(*FLEET, **ROUGH)),
        mission_setup(scenario=tiny(*FLEET, **FIELD)),
        mission_setup(scenario=tiny(*FLEET, **FIELD), layout=Layout.PAPER),
        mission_setup(layout=Layout.RELATIVE),
        mission_setup(scenario=tiny(*FLEET, **FIELD), layout=Layout.RELATIVE),
        mission_setup(scenario=deaf(), layout=Layout.RELATIVE, flown=follower()),
    ],
)
def test_missions_joined_from_messages_are_the_rollouts_to_the_byte(flown: MissionSetup) -> None:
    found = joined(flown.joiner(), reports_of(flown, SEEDS))
    pairs = zip(found, flown.episodes(SEEDS), strict=True)
    assert [same(one.episode, other) for one, other in pairs] == [[] for _ in SEEDS]


def test_a_mission_that_is_cut_off_ends_with_the_decision_it_waits_for() -> None:
    flown = mission_setup(max_decisions=9)
    joiner, reports = flown.joiner(), reports_of(flown, SEEDS)
    for one in joined(joiner, reports):
        assert (one.episode.n_decisions, one.episode.is_whole) == (10, False)
    # What comes after the cut is known to be of no use.
    counts = joiner.counts.reports
    assert counts[ReportOutcome.LATE] == counts[ReportOutcome.DROPPED] == 0
    assert counts.total() == len(events_and_decisions(reports))


def test_a_mission_that_the_world_gave_up_is_cut_off_there() -> None:
    flown = mission_setup()
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
    flown = mission_setup()
    reports = reports_of(flown, SEEDS)
    for one in joined(flown.joiner(), reports):
        events = [
            it for it in reports if isinstance(it, EventReport) and it.mission_id == one.mission_id
        ]
        efficiency = sum(it.collected_bit for it in events) / sum(it.energy_j for it in events)
        assert one.efficiency_kbit_per_j == pytest.approx(efficiency / 1e3)


def test_any_order_of_a_missions_messages_gives_the_same_mission() -> None:
    flown = mission_setup()
    reports = [reports_of(flown, [seed]) for seed in SEEDS]
    rng = np.random.default_rng(0)
    mixed = [each[place] for each in reports for place in rng.permutation(len(each))]
    # The very last message may not be needed, as the second one about the mission.
    found = joined(flown.joiner(), mixed)
    expected = flown.episodes(SEEDS)
    assert [one.mission_id for one in found] == [f'world-{seed}' for seed in SEEDS]
    assert all(not same(one.episode, other) for one, other in zip(found, expected, strict=True))


def test_messages_that_come_twice_are_counted_and_change_nothing() -> None:
    flown = mission_setup()
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
    flown = mission_setup()
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
    flown = mission_setup()
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
    assert joiner.counts.missions_text == '9 missions joined, 1 dropped: 1 incomplete'
    assert joiner.n_waiting == 0
    assert joiner.counts.n_missing == (kind is TransitionReport)  # nothing follows the event
    assert joiner.counts.reports[ReportOutcome.DROPPED] == needed(first)
    assert joined(joiner, [lost]) == []  # too late, and no ghost of a mission
    assert joiner.counts.reports[ReportOutcome.LATE] == 1
    assert joiner.n_waiting == 0


def test_a_mission_waits_for_a_late_message_while_others_are_joined() -> None:
    flown = mission_setup()
    first, later = reports_of(flown, [7]), reports_of(flown, range(20, 27))
    late = first.pop(3)
    found = joined(flown.joiner(), [*first, *later, late])
    assert found[-1].mission_id == 'world-7'
    assert not same(found[-1].episode, flown.episodes([7])[0])


def test_the_report_at_the_end_of_a_mission_makes_up_for_that_at_its_start() -> None:
    flown = mission_setup()
    found = joined(flown.joiner(), reports_of(flown, [7])[1:])
    assert not same(found[0].episode, flown.episodes([7])[0])


def test_what_still_waits_is_dropped_when_no_more_will_come() -> None:
    flown = mission_setup()
    joiner, reports = flown.joiner(), reports_of(flown, [7])
    joined(joiner, reports[:-4])
    joiner.drop_incomplete()
    assert joiner.counts.dropped == {DropReason.MISSING: 1}
    assert joiner.n_waiting == 0


def test_the_messages_that_wait_are_bounded() -> None:
    # Each mission lacks its first event: nothing is ever joined.
    flown = mission_setup()
    joiner = flown.joiner(max_reports=300)
    for seed in range(20):
        assert joined(joiner, reports_of(flown, [seed])[3:]) == []
        assert joiner.n_waiting <= 300
    assert joiner.counts.dropped[DropReason.MISSING] > 5


def test_missions_that_were_joined_before_are_not_joined_again() -> None:
    flown = mission_setup()
    known = MissionIds()
    known.add('world-7')
    joiner = flown.joiner(known=known)
    assert [it.mission_id for it in joined(joiner, reports_of(flown, [7, 8]))] == ['world-8']
    assert joiner.counts.dropped == {}
    assert (joiner.counts.n_joined, joiner.counts.n_known) == (1, 1)


def test_a_mission_that_another_joiner_joins_meanwhile_is_not_joined_again() -> None:
    flown, known = mission_setup(), MissionIds()
    joiner, reports = flown.joiner(known=known), reports_of(flown, [7])
    assert joined(joiner, reports[:-4]) == []
    known.add('world-7')
    assert joined(joiner, reports[-4:]) == []
    assert (joiner.counts.n_known, joiner.n_waiting) == (1, 0)


def test_a_mission_waits_until_its_world_has_said_that_it_is_its_own() -> None:
    flown, asked = mission_setup(), []
    joiner = flown.joiner(ask=asked.append)
    assert joined(joiner, reports_of(flown, SEEDS)) == []
    assert [it.mission_id for it in asked] == [f'world-{seed}' for seed in SEEDS]  # once each
    expected = flown.episodes(SEEDS)
    for mission, other in zip(asked, expected, strict=True):
        one = joiner.answer(mission.mission_id, is_own=True)
        assert one is not None
        assert same(one.episode, other) == []
    assert joiner.n_waiting == 0


def test_a_mission_that_no_world_calls_its_own_is_dropped_whenever_the_answer_comes() -> None:
    flown, asked = mission_setup(), []
    joiner, reports = flown.joiner(ask=asked.append), reports_of(flown, [7])
    for place in (1, len(reports)):
        mission = f'world-{place}'
        of_mission = [changed(it, mission_id=mission) for it in reports]
        assert joined(joiner, of_mission[:place]) == []
        assert joiner.answer(mission, is_own=False) is None
        assert joined(joiner, of_mission[place:]) == []
    assert joiner.counts.dropped == {DropReason.FOREIGN: 2}
    assert joiner.n_waiting == 0
    assert joiner.answer('world-9', is_own=True) is None  # nothing is known of it


def test_numbers_that_no_mission_has_are_refused_and_nothing_else_happens() -> None:
    flown, rng = mission_setup(), np.random.default_rng(0)
    joiner, reports = flown.joiner(), reports_of(flown, [7])
    refusals: list[str] = []
    for number in range(300):
        place = int(rng.integers(len(reports)))
        values = vars(reports[place])
        name = str(rng.choice([*values.keys() - {'mission_id', 'cut_after'}]))
        value = values[name]
        odd: object
        match value:
            case bytes():
                content = bytearray(value)
                start = int(rng.integers(len(content)))
                content[start : start + 8] = rng.bytes(len(content[start : start + 8]))
                odd = bytes(content)
            case float():
                odd = float(rng.choice([np.nan, np.inf, -1.0, 1e300, -1e300, 1e9, 5e-324]))
            case str():
                odd = 'x'
            case _:
                odd = int(rng.choice([-1, 7, 255, 2**31, 2**32 - 1]))
        of_mission = [changed(it, mission_id=f'world-{number}') for it in reports]
        of_mission[place] = changed(of_mission[place], **{name: odd})
        joined(joiner, of_mission, refusals.append)
    joiner.drop_incomplete()
    assert joiner.counts.dropped[DropReason.REFUSED] == len(refusals) > 100
    assert joiner.counts.n_joined + joiner.counts.dropped.total() == 300


def test_a_mission_that_a_failsafe_ended_is_dropped() -> None:
    flown = mission_setup()
    joiner, reports = flown.joiner(), reports_of(flown, [7, 8])
    place = next(
        at for at, it in enumerate(reports) if isinstance(it, EventReport) and it.action == HOME
    )
    reports[place] = changed(reports[place], reason=FAILSAFE)
    assert [it.mission_id for it in joined(joiner, reports)] == ['world-8']
    assert joiner.counts.dropped == {DropReason.FAILSAFE: 1}
    assert joiner.counts.reports[ReportOutcome.LATE] == 0


def test_the_scenarios_reward_is_refused_under_another_discount() -> None:
    with pytest.raises(ConfigError, match=r'discount_per_s is 0\.997: must be 0\.99'):
        mission_setup(reward=Reward.PAPER, discount_per_s=0.997).joiner()


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
    """200 of them, and what the rollout records of them."""
    fleet = uav(5.0, energy_budget_kj=9.0), uav(10.0, energy_budget_kj=5.0)
    flown = MissionSetup(scenario=tiny(*fleet), layout=Layout.PAPER, max_decisions=9)
    return flown, reports_of(flown, range(200)), flown.episodes(range(200))


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
    assert counts.n_joined == len(found) > 40
    reported = {it.mission_id for it in events_and_decisions(arrived)}
    assert counts.n_joined + counts.dropped[DropReason.MISSING] == len(reported)
    assert counts.reports.total() == len(events_and_decisions(arrived))


def test_without_faults_nothing_is_lost(
    short_missions: tuple[MissionSetup, list[FleetReport], list[Episode]],
) -> None:
    flown, reports, _ = short_missions
    joiner = flown.joiner()
    assert len(joined(joiner, reports)) == 200
    assert {*joiner.counts.reports} == {ReportOutcome.USED, ReportOutcome.UNNEEDED}
    assert joiner.counts.dropped == {}
    assert joiner.n_waiting == 0
