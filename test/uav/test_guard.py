"""The guard against circles: when it decides, what it decides, and that every mission ends."""

from dataclasses import dataclass, field
from functools import partial
import math

from fleets import flown_without
from interpreted import interpreted
import numpy as np
import odd_areas
import pytest
from random_policies import header, random_policy
from tiny_world import tiny, uav
from uav_collect.analysis.metrics import check_log, mission_metrics
from uav_collect.kernels.arrays import Row, row_of
from uav_collect.limits import GUARD_AFTER
from uav_collect.missions.rollout import fly
from uav_collect.missions.simulation import fly_by_agents, Simulation
from uav_collect.recording.mission_log import from_jsonl, MissionLog
from uav_collect.scenario.area import cell_of, open_cells
from uav_collect.scenario.load import load
from uav_collect.scenario.model import Scenario
from uav_collect.scenario.site import build_site
from uav_collect.uav.action_codes import (
    BACKWARD,
    BY_POLICY,
    ENERGY_RESERVE,
    FORWARD,
    GUARD,
    HOME,
    HOVER,
    LEFT,
    MAP_COMPLETE,
    RIGHT,
)
from uav_collect.uav.agent import Agent, allocator_named
from uav_collect.uav.belief import Belief
from uav_collect.uav.briefing import Briefing
from uav_collect.uav.messages import Decision, RadioMessage
from uav_collect.uav.observation import Layout
from uav_collect.uav.policy import STRONG
from uav_collect.uav.policy_network import LearnedPolicy
from uav_collect.uav.view import LocalView

RING = (FORWARD, RIGHT, BACKWARD, LEFT)
N_CELLS = 16


@dataclass
class Circling:
    """A policy that flies round a square of two by two cells, and counts how often it is asked."""

    name: str = 'circling'
    version: str = '1'
    n_asked: int = field(default=0, init=False)

    def begin(self, briefing: Briefing, uav: int) -> None:
        self.n_asked = 0

    def choose(self, belief: Belief, view: LocalView, legal: Row[int]) -> int:
        self.n_asked += 1
        wanted = RING[(self.n_asked - 1) % 4]
        return wanted if legal[wanted] else next(a for a in (*RING, HOVER) if legal[a])


@dataclass
class Obedient(Circling):
    """A policy that chooses what the test wants."""

    wanted: int = FORWARD

    def choose(self, belief: Belief, view: LocalView, legal: Row[int]) -> int:
        self.n_asked += 1
        return self.wanted


class Alone:
    """One UAV in a tiny world with data in the north-eastern corner, decision by decision."""

    def __init__(
        self, policy: Circling, guard_after: int, start: tuple[int, int] = (0, 0)
    ) -> None:
        scenario = tiny(uav(5.0, start=start), sensors=[(175.0, 175.0, 1.0)])
        self.simulation = Simulation(build_site(scenario), 0)
        self.policy = policy
        exact = allocator_named('exact')
        self.agent = Agent(self.simulation.briefing, 0, policy, exact, guard_after=guard_after)

    def decide(self) -> Decision:
        event = self.simulation.next_event()
        assert event is not None
        self.agent.observe(event.view)
        decision = self.agent.decide(event.view)
        assert self.simulation.refusal(event, decision) is None
        self.simulation.start(event, decision)
        return decision

    def hear(self, *complete: int) -> None:
        known = row_of([int(cell in complete) for cell in range(N_CELLS)])
        self.agent.hear(RadioMessage(sender=0, complete=known, x_m=0.0, y_m=0.0, time_s=0.0))


def reasons(flight: Alone, n_decisions: int) -> list[int]:
    return [flight.decide().reason for _ in range(n_decisions)]


# When it decides


def test_the_guard_decides_once_so_many_decisions_taught_nothing() -> None:
    # The looks from three corners of the ring show new cells; the next three show none.
    flight = Alone(Circling(), guard_after=3)
    assert reasons(flight, 6) == [BY_POLICY] * 5 + [GUARD]


def test_news_by_radio_give_the_policy_its_say_again_but_no_more_patience() -> None:
    flight = Alone(Obedient(wanted=LEFT), guard_after=2, start=(0, 3))
    flight.hear(*range(N_CELLS - 2))
    assert reasons(flight, 3) == [BY_POLICY, BY_POLICY, GUARD]
    flight.hear(N_CELLS - 2)
    assert reasons(flight, 2) == [BY_POLICY, GUARD]


def test_a_message_without_news_changes_nothing() -> None:
    with_radio, without = (Alone(Circling(), guard_after=3) for _ in range(2))
    for _ in range(10):
        with_radio.hear(0)
        assert with_radio.decide() == without.decide()


def test_the_policy_is_asked_at_every_decision() -> None:
    flight = Alone(Circling(), guard_after=2)
    assert GUARD in reasons(flight, 10)
    assert flight.policy.n_asked == 10


@pytest.mark.parametrize('guard_after', [0, -1])
def test_without_a_guard_the_policy_has_its_way(guard_after: int) -> None:
    assert reasons(Alone(Circling(), guard_after), 60) == [BY_POLICY] * 60


def test_a_policy_that_goes_home_is_let_go() -> None:
    flight = Alone(Circling(), guard_after=2)
    while flight.decide().reason == BY_POLICY:
        pass
    flight.agent.policy = Obedient(wanted=HOME)
    assert flight.decide() == Decision(action=HOME, reason=BY_POLICY)


def test_a_new_mission_begins_with_a_patient_guard() -> None:
    flight = Alone(Circling(), guard_after=3)
    first = reasons(flight, 10)
    flight.agent.begin()
    flight.simulation = Alone(Circling(), guard_after=3).simulation
    assert reasons(flight, 10) == first


def test_an_agent_that_lives_through_its_observations_again_guards_as_before() -> None:
    flight = Alone(Circling(), guard_after=3)
    views, decisions = [], []
    for _ in range(12):
        event = flight.simulation.next_event()
        assert event is not None
        views.append(event.view._replace(region_bit=row_of(list(event.view.region_bit))))
        decisions.append(flight.decide())
    restarted = Alone(Circling(), guard_after=3).agent
    for view, decision in zip(views, decisions, strict=True):
        restarted.observe(view)
        if decision.action != HOVER:  # a view's sensors are those of the moment
            assert restarted.decide(view) == decision
        else:
            restarted.decide(view)
    assert GUARD in [decision.reason for decision in decisions]


# What it decides


def test_the_guard_hovers_where_data_waits() -> None:
    flight = Alone(Obedient(wanted=RIGHT), guard_after=1, start=(3, 2))
    flight.hear(*range(N_CELLS - 1))
    assert (flight.decide().action, flight.decide().action) == (RIGHT, HOVER)


def test_the_guard_makes_for_the_nearest_open_cell() -> None:
    # All but the north-eastern corner is known: the policy flies west, the guard turns east.
    flight = Alone(Obedient(wanted=LEFT), guard_after=1, start=(0, 2))
    flight.hear(*range(N_CELLS - 1))
    assert flight.decide().action == LEFT
    way = [flight.decide() for _ in range(2)]
    assert [step.action for step in way] == [FORWARD, FORWARD]
    assert {step.reason for step in way} == {GUARD}


def test_what_lies_straight_behind_is_reached_by_a_step_aside() -> None:
    flight = Alone(Obedient(wanted=BACKWARD), guard_after=1, start=(1, 0))
    flight.hear(*[cell for cell in range(N_CELLS) if cell != 12])
    assert flight.decide().action == BACKWARD
    assert [flight.decide().action for _ in range(2)] == [RIGHT, FORWARD]


# Who has one


def flown(
    scenario: Scenario, policy: object, guard_after: int, allocator: str = 'equal'
) -> list[MissionLog]:
    site = build_site(scenario)
    return fly(site, [3, 4], policy, allocator, guard_after)  # type: ignore[arg-type]


@pytest.mark.parametrize('rule', ['hert', 'sweep', 'random'])
def test_rules_have_no_guard(rule: str) -> None:
    scenario = load('paper_8x8', {'fleet.default.energy_budget_kj': 60.0})
    texts = [[log.to_jsonl() for log in flown(scenario, rule, k)] for k in (0, 1, 12)]
    assert texts[0] == texts[1] == texts[2]


def random_flights(allocator: str = 'equal') -> str:
    """The logs of missions by random weights and guards of little patience."""
    scenario = load('paper_8x8', {'fleet.default.energy_budget_kj': 90.0})
    frozen = random_policy(header(Layout.EGOCENTRIC, side=8), seed=3)
    logs = flown(scenario, partial(LearnedPolicy, 'mine', frozen), 5, allocator)
    assert any((log.events['reason'] == GUARD).any() for log in logs)
    return b''.join(log.to_jsonl() for log in logs).decode()


def test_interpreted_guards_decide_as_compiled_ones_do() -> None:
    assert interpreted(random_flights) == random_flights()


def test_agents_are_guarded_as_missions_at_once_are() -> None:
    scenario = load('paper_8x8', {'fleet.default.energy_budget_kj': 90.0})
    frozen = random_policy(header(Layout.EGOCENTRIC, side=8), seed=3)
    learned = partial(LearnedPolicy, 'mine', frozen)
    for log in flown(scenario, learned, 5):
        simulation = Simulation(build_site(scenario), log.header.mission_seed)
        agents = [
            Agent(simulation.briefing, unit, learned(), allocator_named('equal'), guard_after=5)
            for unit in range(2)
        ]
        while (event := simulation.next_event()) is not None:
            agent = agents[event.uav]
            for message in event.heard:
                agent.hear(message)
            agent.observe(event.view)
            for hearer in simulation.transmit(event.uav, agent.belief.complete):
                agents[hearer].hear(simulation.radio(event.uav))
            simulation.start(event, agent.decide(event.view))
        assert simulation.log(log.header).to_jsonl() == log.to_jsonl()


def test_functions_are_guarded_as_networks_are() -> None:
    scenario = load('paper_8x8')
    [first, _] = flown(scenario, Circling, GUARD_AFTER)
    assert mission_metrics(first).is_complete
    assert mission_metrics(first).n_guarded > 0
    [circled, _] = flown(scenario, Circling, 0)
    assert not mission_metrics(circled).is_complete


def test_a_log_says_how_patient_guards_were_unless_as_patient_as_always() -> None:
    scenario = tiny(uav(5.0))
    for guard_after in (0, 5, GUARD_AFTER):
        text = flown(scenario, Circling, guard_after)[0].to_jsonl()
        assert (b'guard_after' in text) is (guard_after != GUARD_AFTER)
        head = from_jsonl(text).header
        assert [unit.guard_after for unit in head.uavs] == [guard_after]


def test_a_guarded_mission_adds_up() -> None:
    for log in flown(load('paper_8x8'), Circling, 4):
        check_log(log)
        mission = mission_metrics(log)
        assert mission.n_guarded == sum(unit.n_guarded for unit in mission.uavs)
        assert mission.n_guarded == (log.events['reason'] == GUARD).sum()


# With a peer gone


@pytest.mark.parametrize('policy', ['sweep', STRONG])
def test_whenever_a_peer_is_gone_all_data_is_collected(policy: str) -> None:
    scenario, rng = load('paper_10x10'), np.random.default_rng(5)
    n_guarded = 0
    for seed in range(25):
        since = int(rng.integers(60))
        log = flown_without(scenario, seed, policy, uav=int(rng.integers(2)), since=since)
        mission = mission_metrics(log)
        assert mission.is_complete
        n_guarded += mission.n_guarded
    assert (n_guarded > 0) is (policy == STRONG)


# That every mission ends

N_NETWORKS, PER_SCENARIO = 300, 10


def random_scenario(rng: np.random.Generator) -> Scenario:
    """An area of 2 to 8 cells a side, 1 to 4 UAVs, any radio, budgets from scarce to endless."""
    side, n_uavs = int(rng.integers(2, 9)), int(rng.integers(1, 5))
    place = [int(cell) for cell in rng.integers(0, side, 2)]
    return load(
        'paper_10x10',
        {
            'area.cells_per_side': side,
            'sensors.seed': int(rng.integers(1000)),
            'demand.cell_share': float(rng.uniform(0.05, 0.9)),
            'radio.contact_range_m': float(rng.choice([0.0, 60.0, 200.0, math.inf])),
            'fleet.default.energy_budget_kj': float(rng.choice([30.0, 90.0, 1e6])),
            'fleet.default.home': {'cell': place},
            'fleet.uavs': [{'speed_mps': float(rng.uniform(4.0, 15.0))} for _ in range(n_uavs)],
        },
    )


def most_decisions(log: MissionLog, guard_after: int) -> float:
    """The bound of `agent.guarded`, for a hover that costs no more than a move."""
    side = log.header.n_rows
    way_home = math.sqrt(2.0) * side
    return side * side * (guard_after + 2 * side + 1) + way_home + 3


def test_random_networks_end_with_the_map_complete_or_at_the_reserve_within_the_bound() -> None:
    rng = np.random.default_rng(13)
    ends, n_endless = set(), 0
    for _ in range(N_NETWORKS // PER_SCENARIO):
        scenario = random_scenario(rng)
        site, guard_after = build_site(scenario), int(rng.choice([1, 5, GUARD_AFTER]))
        of = header(Layout.EGOCENTRIC, scenario.area.n_rows, scenario.n_uavs, hidden_size=8)
        for _ in range(PER_SCENARIO):
            frozen = random_policy(of, seed=int(rng.integers(2**31)))
            seed = int(rng.integers(2**31))
            learned = partial(LearnedPolicy, 'mine', frozen)
            [log] = fly(site, [seed], learned, 'equal', guard_after)
            turns = log.events[log.events['action'] == HOME]
            ends |= {*turns['reason'].tolist()}
            assert np.bincount(log.events['uav']).max() <= most_decisions(log, guard_after)
            if scenario.uavs[0].energy_budget_j > 1e8:
                n_endless += 1
                assert mission_metrics(log).is_complete
    assert ends == {MAP_COMPLETE, ENERGY_RESERVE}
    assert n_endless > N_NETWORKS // 5


@pytest.mark.parametrize('guard_after', [1, GUARD_AFTER])
def test_random_networks_end_in_a_maze_with_dead_ends_and_leave_nothing(guard_after: int) -> None:
    scenario = odd_areas.maze(
        fleet__default__energy_budget_kj=1e6,
        radio__contact_range_m=100.0,
        sensors__sparse_mean=3,  # so that the ends of the ways hold data
    )
    site, is_open = build_site(scenario), open_cells(scenario.area)
    for seed in range(3):
        frozen = random_policy(header(Layout.EGOCENTRIC, 9, scenario.n_uavs, hidden_size=8), seed)
        learned = partial(LearnedPolicy, 'mine', frozen)
        [log] = fly(site, [seed], learned, 'equal', guard_after)
        # Each cell takes the guard's patience and a way through all the others, at most.
        most = int(is_open.sum()) * (guard_after + int(is_open.sum()) + 1)
        assert np.bincount(log.events['uav']).max() <= most
        assert mission_metrics(log).is_complete
        assert mission_metrics(log).n_guarded > 0
        cells = [cell_of(scenario.area, it) for it in log.events[['x_m', 'y_m']].tolist()]
        assert is_open[cells].all()


def test_a_guard_leads_out_of_a_pocket_through_the_maze_a_policy_that_would_stay_there() -> None:
    home = {'cell': [1, 3]}
    scenario = odd_areas.maze(
        sensors={'kind': 'listed', 'entries': [{'id': 'S', 'x_m': 25.0, 'y_m': 425.0}]},
        demand={'cell_share': 'all', 'data_mbit': [1.0, 1.0], 'known_empty': 'none'},
        fleet__uavs=[{'speed_mps': 10.0, 'start': home, 'home': home}],
    )
    log = fly_by_agents(build_site(scenario), 0, Circling, 'exact', 3)
    assert mission_metrics(log).is_complete
    assert log.events['reason'][-1] == MAP_COMPLETE
