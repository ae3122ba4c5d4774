from dataclasses import dataclass, replace
import math
import re

import numpy as np
import pytest
from tiny_world import Flight, fly_scripts, MOVE_5_J, tiny, uav
from uav_collect.analysis.metrics import check_log, mission_metrics
from uav_collect.errors import ConfigError
from uav_collect.kernels.arrays import Row, row_of
from uav_collect.missions.rollout import fly
from uav_collect.missions.simulation import Simulation
from uav_collect.recording.mission_log import from_jsonl
from uav_collect.scenario.load import load
from uav_collect.scenario.model import Scenario
from uav_collect.scenario.site import build_site
from uav_collect.uav.action_codes import (
    BACKWARD,
    BY_POLICY,
    ENERGY_RESERVE,
    FAILSAFE,
    FORWARD,
    HOME,
    HOVER,
    LEFT,
    MAP_COMPLETE,
    N_ACTIONS,
    RIGHT,
)
from uav_collect.uav.agent import Agent, allocator_named
from uav_collect.uav.belief import Belief
from uav_collect.uav.briefing import Briefing
from uav_collect.uav.messages import Decision
from uav_collect.uav.view import LocalView

BANDWIDTH_HZ = 1e6  # of the only UAV
SENSORS_B = (1, 2)


def decision(
    action: int, *share_hz: float, reason: int = BY_POLICY, sensor: tuple[int, ...] = SENSORS_B
) -> Decision:
    if action != HOVER:
        sensor = ()
    return Decision(action=action, reason=reason, sensor=sensor, share_hz=share_hz)


def refusal(scenario: Scenario, command: Decision, *before: int) -> str | None:
    flight = Flight(scenario)
    for action in before:
        flight.step(action)
    return flight.simulation.refusal(flight.look(), command)


def over_b(**values: float) -> Scenario:
    """One UAV starts over cell B with its two sensors."""
    return tiny(uav(5.0, start=(2, 2), **values))


@pytest.mark.parametrize('action', [-1, 6, 7, 255])
def test_an_unknown_action_is_refused(action: int) -> None:
    assert refusal(over_b(), decision(action)) == f'action {action} is none of 0..5'


@pytest.mark.parametrize(
    ('action', 'reason'),
    [(HOME, -1), (HOME, FAILSAFE), (HOME, 4), (HOME, 255), (LEFT, MAP_COMPLETE), (LEFT, 5)],
)
def test_a_reason_that_an_agent_cannot_have_is_refused(action: int, reason: int) -> None:
    refused = refusal(over_b(), decision(action, reason=reason))
    assert refused == f'reason {reason} is none for action {action}'


def test_a_hover_without_data_is_refused() -> None:
    refused = refusal(tiny(uav(5.0)), decision(HOVER, 1e5))
    assert refused == 'a hover, but no data waits in the cell'


def test_a_second_hover_over_the_same_data_is_refused() -> None:
    command = decision(HOVER, 1e5, 1e5)
    assert refusal(over_b(), command, HOVER) == 'a hover, but no data waits in the cell'


@pytest.mark.parametrize('share_hz', [(), (1e5,), (1e5, 1e5, 1e5)])
def test_a_wrong_number_of_shares_is_refused(share_hz: tuple[float, ...]) -> None:
    refused = refusal(over_b(), decision(HOVER, *share_hz))
    assert refused == f'{len(share_hz)} bandwidth shares for 2 sensors'


@pytest.mark.parametrize('sensor', [(), (1,), (2, 1), (0, 1), (1, 2, 2)])
def test_bandwidth_for_other_sensors_than_those_with_data_is_refused(
    sensor: tuple[int, ...],
) -> None:
    refused = refusal(over_b(), decision(HOVER, 1e5, 1e5, sensor=sensor))
    assert refused == f'bandwidth for the sensors {sensor}, but data waits at {SENSORS_B}'


@pytest.mark.parametrize('share_hz', [math.nan, math.inf, -math.inf, -1.0, 0.0, -0.0])
def test_a_share_that_is_no_positive_number_is_refused(share_hz: float) -> None:
    refused = refusal(over_b(), decision(HOVER, 1e5, share_hz))
    assert refused == f'a bandwidth share of {share_hz} Hz: each must be above 0 and finite'


@pytest.mark.parametrize(
    'share_hz', [(6e5, 4.0001e5), (1e6 * (1 + 1e-6), 1.0), (1e300, 1e300), (1e308, 1e308)]
)
def test_more_bandwidth_than_there_is_is_refused(share_hz: tuple[float, float]) -> None:
    refused = refusal(over_b(), decision(HOVER, *share_hz)) or ''
    assert re.fullmatch(r'bandwidth shares sum to \S+ Hz of 1e\+06 Hz', refused)


@pytest.mark.parametrize(
    'share_hz', [(5e5, 5e5), (1e5, 1e5), (5e5, 5e5 * (1 + 1e-12)), (999_900.0, 100.0)]
)
def test_bandwidth_up_to_all_there_is_is_allowed(share_hz: tuple[float, float]) -> None:
    assert sum(share_hz) <= BANDWIDTH_HZ * (1 + 1e-9)
    assert refusal(over_b(), decision(HOVER, *share_hz)) is None


@pytest.mark.parametrize('share_hz', [(1e-3, 1e5), (1e-200, 1e5), (5e-324, 1e5)])
def test_a_hover_beyond_the_reserve_is_refused(share_hz: tuple[float, float]) -> None:
    # On 1 mHz half a megabit takes weeks; on the smallest double, for ever.
    refused = refusal(over_b(), decision(HOVER, *share_hz)) or ''
    assert re.fullmatch(
        r'a hover of \S+ s would leave too little energy for the way home', refused
    )


@pytest.mark.parametrize(('spare_j', 'is_refused'), [(55.0, False), (54.0, True)])
def test_the_reserve_is_reckoned_with_the_hover_that_the_shares_allow(
    spare_j: float, is_refused: bool
) -> None:
    # B is hypot(100, 100) m from home. Of two UAVs each has 0.5 MHz: an eighth of a MHz for the
    # 0.25 Mbit takes 0.3233 s, 54.47 J; equal shares take 0.3842 s, 64.7 J for the 0.5 Mbit.
    budget_kj = (math.sqrt(8.0) * MOVE_5_J + 1000.0 + spare_j) / 1e3
    poor = uav(5.0, start=(2, 2), home_m=(25.0, 25.0), energy_budget_kj=budget_kj)
    scenario = tiny(poor, uav(5.0))
    assert refusal(scenario, decision(HOVER, 2.5e5, 2.5e5)) is not None
    assert (refusal(scenario, decision(HOVER, 3.75e5, 1.25e5)) is not None) is is_refused


@pytest.mark.parametrize(
    ('command', 'before', 'place'),
    [
        (LEFT, [RIGHT], r'at \(75, 25\) m after action 2 with 998564 J left'),
        (BACKWARD, [RIGHT], r'at \(75, 25\) m after action 2'),
        (LEFT, [], r'at \(25, 25\) m after action -1 with 1000000 J left'),
        (BACKWARD, [FORWARD, FORWARD], r'at \(25, 125\) m after action 1'),
        (RIGHT, [RIGHT, RIGHT, RIGHT], r'at \(175, 25\) m after action 2'),
    ],
)
def test_an_illegal_move_is_refused(command: int, before: list[int], place: str) -> None:
    refused = refusal(tiny(uav(5.0)), decision(command), *before) or ''
    assert re.match(f'action {command} is illegal {place}', refused)


def test_a_move_beyond_the_reserve_is_refused() -> None:
    budget_kj = (3 * MOVE_5_J + 1000.0) / 1e3
    scenario = tiny(uav(5.0, energy_budget_kj=budget_kj))
    assert refusal(scenario, decision(RIGHT)) is None
    refused = refusal(scenario, decision(RIGHT), RIGHT) or ''
    assert refused.startswith('action 2 is illegal at (75, 25) m')


def test_the_way_home_is_never_refused() -> None:
    assert refusal(over_b(), decision(HOME)) is None
    assert refusal(over_b(), replace(decision(HOME), reason=MAP_COMPLETE), HOVER, LEFT) is None


@pytest.mark.parametrize('action', [RIGHT, HOME])
def test_bandwidth_is_for_hovers_alone(action: int) -> None:
    words = f'sensors, but action {action} collects from none'
    many = tuple([1e4] * 50)
    assert (
        refusal(over_b(), replace(decision(action), share_hz=many)) == f'bandwidth for 50 {words}'
    )
    assert refusal(over_b(), replace(decision(action), sensor=(0,))) == f'bandwidth for 1 {words}'


def test_a_refusal_changes_nothing() -> None:
    undisturbed = fly_scripts(over_b(), [HOVER, LEFT, LEFT])
    flight = Flight(over_b())
    for action in (HOVER, LEFT, LEFT, HOME):
        event = flight.look()
        for bad in (decision(99), decision(HOVER, math.nan, 1.0), decision(RIGHT, reason=7)):
            assert flight.simulation.refusal(event, bad) is not None
        flight.act(event, action)
    assert flight.simulation.events().tolist() == undisturbed.events.tolist()


@dataclass
class Curious:
    """A policy that flies at random and keeps the mask it was given."""

    seed: int
    name: str = 'curious'
    version: str = '1'
    legal: tuple[int, ...] = ()

    def begin(self, briefing: Briefing, uav: int) -> None:
        self._rng = np.random.default_rng([self.seed, uav])

    def choose(self, belief: Belief, view: LocalView, legal: Row[int]) -> int:
        self.legal = tuple(action for action in range(N_ACTIONS) if legal[action])
        return HOVER if HOVER in self.legal else int(self._rng.choice(self.legal))


@pytest.mark.parametrize('seed', [0, 1, 2])
def test_what_is_refused_is_exactly_what_the_mask_forbids(seed: int) -> None:
    site = build_site(load('paper_8x8', {'fleet.default.energy_budget_kj': 30.0}))
    simulation = Simulation(site, seed)
    exact = allocator_named('exact')
    agents = [Agent(simulation.briefing, unit, Curious(seed), exact) for unit in range(2)]
    verdicts = set()
    while (event := simulation.next_event()) is not None:
        agent = agents[event.uav]
        agent.observe(event.view)
        chosen = agent.decide(event.view)
        assert simulation.refusal(event, chosen) is None
        if chosen.reason == BY_POLICY:
            for action in range(FORWARD, N_ACTIONS):
                is_legal = simulation.refusal(event, decision(action)) is None
                assert is_legal is (action in agent.policy.legal)
                verdicts.add(is_legal)
        simulation.start(event, chosen)
    assert simulation.n_events > 40
    assert verdicts == {True, False}


# Whether a mission can start


def start_refusal(scenario: Scenario) -> str:
    with pytest.raises(ConfigError) as alone:
        Simulation(build_site(scenario), 0)
    with pytest.raises(ConfigError) as in_a_batch:
        fly(build_site(scenario), [0], 'sweep')
    assert str(alone.value) == str(in_a_batch.value)
    return str(alone.value)


def test_a_mission_in_which_nobody_can_move_says_what_everybody_needs() -> None:
    scenario = tiny(uav(5.0, energy_budget_kj=2.0), uav(10.0, energy_budget_kj=1.5))
    assert start_refusal(scenario) == (
        'scenario tiny: no UAV has the energy for a single move: '
        'UAV 1 has 2 kJ; the way home from its start costs 0 kJ, a move 1.436 kJ, '
        'and 1 kJ must be left when it lands; '
        'UAV 2 has 1.5 kJ; the way home from its start costs 0 kJ, a move 0.6302 kJ, '
        'and 1 kJ must be left when it lands'
    )


def test_a_mission_starts_if_one_uav_can_move() -> None:
    scenario = tiny(uav(5.0, energy_budget_kj=2.0), uav(10.0))
    log = fly_scripts(scenario, [RIGHT], [FORWARD])
    assert log.events['action'].tolist() == [HOME, FORWARD, HOME]
    assert log.events['reason'].tolist() == [ENERGY_RESERVE, BY_POLICY, BY_POLICY]


def test_a_mission_in_which_one_uav_cannot_even_fly_home_does_not_start() -> None:
    # 150 m at 10 m/s cost 1.89 kJ.
    far = uav(10.0, home_m=(175.0, 25.0), energy_budget_kj=2.8)
    assert start_refusal(tiny(uav(5.0), far)) == (
        'scenario tiny: too little energy for the way home: '
        'UAV 2 has 2.8 kJ; the way home from its start costs 1.891 kJ, a move 0.6302 kJ, '
        'and 1 kJ must be left when it lands'
    )
    just = uav(10.0, home_m=(175.0, 25.0), energy_budget_kj=2.9)
    landed = mission_metrics(fly_scripts(tiny(uav(5.0), just), [RIGHT], [])).uavs[1]
    assert landed.is_safe


def test_an_area_of_one_cell_is_hovered_over() -> None:
    site = build_site(tiny(uav(5.0), sensors=[(20.0, 30.0, 1.0)], area__cells_per_side=1))
    for policy in ('hert', 'sweep', 'random'):
        events = fly(site, [0], policy)[0].events
        assert events['action'].tolist() == [HOVER, HOME]
        assert events['reason'].tolist() == [BY_POLICY, MAP_COMPLETE]


# The state of a mission in flight


def test_a_mission_tells_how_far_it_is() -> None:
    flight = Flight(tiny(uav(5.0, start=(0, 1), home_m=(25.0, 25.0))))
    simulation = flight.simulation
    assert simulation.demand_bit == [1e6, 0.5e6, 0.25e6]
    assert (simulation.n_events, simulation.is_over, simulation.phase(0, 0.0)) == (0, False, 0)
    flight.step(HOVER)
    assert sum(simulation.waiting_bit()) == 0.75e6
    flight.step(HOME)
    end_s = simulation.end_s
    assert simulation.is_over
    assert simulation.next_event() is None
    assert end_s == pytest.approx(simulation.time_s + 10.0)
    assert [simulation.phase(0, time_s) for time_s in (end_s - 1e-6, end_s)] == [1, 2]
    assert simulation.n_events == len(simulation.events()) == 2
    assert simulation.last_event().tolist() == simulation.events()[-1:].tolist()


def test_numbers_of_an_event_are_pythons_own_so_that_a_message_can_carry_them() -> None:
    event = Flight(tiny()).simulation.next_event()
    assert event is not None
    assert [type(each) for each in (event.index, event.uav, event.decision)] == [int] * 3


def test_a_radio_answers_with_all_its_uav_sent_and_it_heard() -> None:
    simulation = Flight(tiny(uav(5.0), uav(5.0), uav(5.0, start=(3, 3)))).simulation
    simulation.next_event()
    assert simulation.transmit(0, row_of([1] * 3 + [0] * 13)) == [1]  # the third is out of range
    assert [[*simulation.known_complete(unit)][:4] for unit in range(3)] == [
        [1, 1, 1, 0],
        [1, 1, 1, 0],
        [0, 0, 0, 0],
    ]
    simulation.transmit(0, row_of([0, 0, 0, 1] + [0] * 12))
    assert [*simulation.radio(0).complete][:4] == [1, 1, 1, 1]


def test_the_log_of_a_mission_in_flight_is_the_log_so_far() -> None:
    whole = fly_scripts(tiny(), [RIGHT, HOVER], [FORWARD, FORWARD])
    flight = Flight(tiny())
    for number, action in enumerate((RIGHT, FORWARD, FORWARD, HOVER), start=1):
        flight.step(action)
        so_far = flight.simulation.log(whole.header)
        check_log(so_far)
        # The interval of the last event is open until the next one.
        assert so_far.events[: number - 1].tolist() == whole.events[: number - 1].tolist()


def test_a_mission_of_any_length_is_logged() -> None:
    around = [FORWARD, RIGHT, BACKWARD, LEFT] * 300
    log = fly_scripts(tiny(uav(10.0, energy_budget_kj=1e6)), around)
    assert len(log.events) == 1201
    check_log(log)


def test_sixty_four_uavs_keep_apart() -> None:
    fleet = [uav(5.0) for _ in range(64)]
    log = fly_scripts(tiny(*fleet), *[[RIGHT]] * 64)
    everybody = 2**64 - 1
    assert [int(heard) for heard in log.events['heard'][:64]] == [
        everybody - (1 << unit) for unit in range(64)
    ]
    assert from_jsonl(log.to_jsonl()).events.tolist() == log.events.tolist()
