from dataclasses import dataclass, field

import pytest
from tiny_world import fly_scripts, MOVE_5_J, rate_bps, tiny, uav
from uav_collect.errors import AllocationError, PolicyMismatchError
from uav_collect.kernels.arrays import Row, row_of
from uav_collect.limits import ALLOCATOR_NAMES
from uav_collect.missions.simulation import Simulation
from uav_collect.scenario.model import Scenario
from uav_collect.scenario.site import build_site
from uav_collect.uav.action_codes import (
    BY_POLICY,
    ENERGY_RESERVE,
    FORWARD,
    HOME,
    HOVER,
    LEFT,
    MAP_COMPLETE,
    N_ACTIONS,
    RIGHT,
)
from uav_collect.uav.agent import Agent, allocator_named, new_workspace
from uav_collect.uav.belief import Belief, NEVER
from uav_collect.uav.briefing import brief, Briefing
from uav_collect.uav.messages import Decision, RadioMessage
from uav_collect.uav.policy import policy_named
from uav_collect.uav.view import LocalView

N_CELLS = 16


@dataclass
class Noting:
    """A policy that answers as it is told and notes what it was asked."""

    answer: int = HOME
    name: str = 'noting'
    version: str = '1'
    begun: list[int] = field(default_factory=list)
    asked: list[list[int]] = field(default_factory=list)
    n_complete: list[int] = field(default_factory=list)

    def begin(self, briefing: Briefing, uav: int) -> None:
        self.begun.append(uav)

    def choose(self, belief: Belief, view: LocalView, legal: Row[int]) -> int:
        self.asked.append([action for action in range(N_ACTIONS) if legal[action]])
        self.n_complete.append(int(belief.n_complete[0]))
        return self.answer


def first_view(scenario: Scenario, unit: int = 0) -> LocalView:
    simulation = Simulation(build_site(scenario), 0)
    for _ in range(unit):
        event = simulation.next_event()
        assert event is not None
        simulation.start(event, Decision(action=HOME, reason=BY_POLICY))
    event = simulation.next_event()
    assert event is not None
    return event.view


def decided(
    scenario: Scenario, policy: Noting, *, allocator: str = 'exact', known: list[int] | None = None
) -> tuple[Decision, LocalView]:
    """What the first UAV decides first, having heard the map `known`."""
    agent = Agent(brief(scenario), 0, policy, allocator_named(allocator))
    view = first_view(scenario)
    if known is not None:
        agent.hear(message(known))
    agent.observe(view)
    return agent.decide(view), view


def message(complete: list[int], sender: int = 1, time_s: float = 0.0) -> RadioMessage:
    return RadioMessage(
        sender=sender, complete=row_of(complete), x_m=75.0, y_m=125.0, time_s=time_s
    )


def test_the_policy_chooses_among_the_legal_actions() -> None:
    policy = Noting(RIGHT)
    decision, _ = decided(tiny(uav(5.0, start=(0, 1))), policy)
    assert policy.asked == [[HOVER, FORWARD, RIGHT, LEFT]]
    assert (decision.action, decision.reason) == (RIGHT, BY_POLICY)


def test_the_policy_decides_on_a_belief_that_holds_the_latest_view() -> None:
    policy = Noting(RIGHT)
    decided(tiny(), policy)
    assert policy.n_complete == [3]


def test_a_policy_may_go_home_by_choice() -> None:
    decision, _ = decided(tiny(), Noting(HOME))
    assert decision == Decision(action=HOME, reason=BY_POLICY)


def test_a_uav_whose_map_is_complete_goes_home_unasked() -> None:
    policy = Noting(RIGHT)
    decision, _ = decided(tiny(), policy, known=[1] * N_CELLS)
    assert decision == Decision(action=HOME, reason=MAP_COMPLETE)
    assert policy.asked == []


def test_one_incomplete_cell_keeps_a_uav_going() -> None:
    policy = Noting(RIGHT)
    decision, _ = decided(tiny(), policy, known=[1] * 15 + [0])
    assert decision.action == RIGHT


def test_the_view_completes_what_hearing_left_open() -> None:
    # Cells 0, 4 and 5 are empty and in view from the start.
    known = [int(cell not in (0, 4, 5)) for cell in range(N_CELLS)]
    decision, _ = decided(tiny(), Noting(RIGHT), known=known)
    assert decision.reason == MAP_COMPLETE


def test_a_uav_that_can_afford_no_action_goes_home_unasked() -> None:
    policy = Noting(RIGHT)
    scenario = tiny(uav(5.0, energy_budget_kj=(2 * MOVE_5_J + 900.0) / 1e3), uav(5.0))
    decision, _ = decided(scenario, policy)
    assert decision == Decision(action=HOME, reason=ENERGY_RESERVE)
    assert policy.asked == []


def test_a_hover_it_cannot_afford_is_not_offered() -> None:
    # From A, 50 m from home: a hover costs 79 J, a move north some 1436 J and a longer way home.
    budget_kj = (MOVE_5_J + 1000.0 + 20.0) / 1e3
    scenario = tiny(
        uav(5.0, start=(0, 1), home_m=(25.0, 25.0), energy_budget_kj=budget_kj), uav(5.0)
    )
    policy = Noting(LEFT)
    decided(scenario, policy)
    assert policy.asked == [[LEFT]]


def test_a_hover_names_its_sensors_and_shares_all_the_bandwidth() -> None:
    decision, _ = decided(tiny(uav(5.0, start=(2, 2))), Noting(HOVER))
    assert (decision.action, decision.sensor) == (HOVER, (1, 2))
    assert sum(decision.share_hz) == pytest.approx(1e6, rel=1e-12)
    ends_s = [
        bit / rate_bps(share_hz)
        for bit, share_hz in zip((0.5e6, 0.25e6), decision.share_hz, strict=True)
    ]
    assert ends_s[0] == pytest.approx(ends_s[1], rel=1e-6)


def test_the_bandwidth_of_the_system_is_split_among_the_uavs() -> None:
    decision, _ = decided(tiny(uav(5.0, start=(2, 2)), uav(5.0), uav(5.0)), Noting(HOVER))
    assert sum(decision.share_hz) == pytest.approx(1e6 / 3, rel=1e-12)


def test_equal_shares_are_equal() -> None:
    decision, _ = decided(tiny(uav(5.0, start=(2, 2))), Noting(HOVER), allocator='equal')
    assert decision.share_hz == (5e5, 5e5)


def test_cvxpy_shares_as_the_exact_allocator_does() -> None:
    scenario = tiny(uav(5.0, start=(2, 2)))
    exact, _ = decided(scenario, Noting(HOVER))
    solved, _ = decided(scenario, Noting(HOVER), allocator='cvxpy')
    assert solved.share_hz == pytest.approx(exact.share_hz, rel=1e-5)


@pytest.mark.parametrize('allocator', ALLOCATOR_NAMES)
@pytest.mark.parametrize('error_variance', [0.0, 0.3])
def test_a_hover_takes_as_long_as_its_allocator_reckoned(
    allocator: str, error_variance: float
) -> None:
    scenario = tiny(uav(5.0, start=(2, 2)), radio__csi_error_variance=error_variance)
    reckoned_s = allocator_named(allocator)(
        brief(scenario), first_view(scenario), new_workspace(2)
    )
    flown = fly_scripts(scenario, [HOVER], allocator=allocator)
    assert flown.events['duration_s'][0] == pytest.approx(reckoned_s, rel=1e-9)


@pytest.mark.parametrize('allocator', ALLOCATOR_NAMES)
def test_where_no_data_waits_no_allocator_is_in_the_way(allocator: str) -> None:
    decision, _ = decided(tiny(), Noting(FORWARD), allocator=allocator)
    assert decision == Decision(action=FORWARD, reason=BY_POLICY)


def test_only_a_hover_shares_bandwidth() -> None:
    decision, _ = decided(tiny(uav(5.0, start=(2, 2))), Noting(RIGHT))
    assert (decision.sensor, decision.share_hz) == ((), ())


def test_an_agent_serves_any_number_of_sensors() -> None:
    sensors = [(25.0, 25.0, 0.1 + number / 100) for number in range(40)]
    scenario = tiny(uav(5.0), sensors=sensors)
    decision, view = decided(scenario, Noting(HOVER))
    assert view.n_sensors == len(decision.share_hz) == 40
    assert decision.sensor == tuple(range(40))


def test_a_new_mission_forgets_the_last_one() -> None:
    policy = Noting(RIGHT)
    agent = Agent(brief(tiny()), 1, policy, allocator_named('exact'))
    agent.hear(message([1] * N_CELLS, sender=0, time_s=7.0))
    agent.begin()
    assert agent.belief.n_complete[0] == 0
    assert agent.belief.peer_s[0] == NEVER
    assert policy.begun == [1, 1]


def test_what_an_agent_sends_is_its_map_and_place() -> None:
    scenario = tiny()
    agent = Agent(brief(scenario), 0, Noting(), allocator_named('exact'))
    view = first_view(scenario)
    agent.observe(view)
    sent = agent.message(view)
    assert (sent.sender, sent.x_m, sent.y_m, sent.time_s) == (0, 25.0, 25.0, 0.0)
    assert [cell for cell in range(N_CELLS) if sent.complete[cell]] == [0, 4, 5]


@pytest.mark.parametrize('name', ALLOCATOR_NAMES)
def test_every_allocator_has_a_name(name: str) -> None:
    assert callable(allocator_named(name))


def test_an_unknown_allocator_is_named_with_those_there_are() -> None:
    with pytest.raises(AllocationError, match="'best' is unknown; there are exact, equal, cvxpy"):
        allocator_named('best')


@pytest.mark.parametrize('name', ['hert', 'hert-equal', 'sweep', 'random'])
def test_every_rule_has_a_name(name: str) -> None:
    assert policy_named(name).name == name


def test_an_unknown_policy_is_named_with_those_there_are() -> None:
    with pytest.raises(
        PolicyMismatchError, match="'wisest' is unknown; there are hert, hert-equal, sweep, random"
    ):
        policy_named('wisest')


def test_a_rule_must_begin_before_it_chooses() -> None:
    view = first_view(tiny())
    agent = Agent(brief(tiny()), 0, Noting(), allocator_named('exact'))
    with pytest.raises(RuntimeError, match='must begin a mission'):
        policy_named('hert').choose(agent.belief, view, row_of([0, 1, 1, 0, 0]))
