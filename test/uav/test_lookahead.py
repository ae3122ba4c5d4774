"""A rule that looks ahead: what it imagines, what it does with that, and how it is named."""

from fleets import scenario_of
import pytest
from tiny_world import tiny, uav
from uav_collect.analysis.choosing import candidates_for, planned_missions
from uav_collect.errors import PolicyMismatchError
from uav_collect.kernels.arrays import new_row
from uav_collect.limits import GUARD_AFTER
from uav_collect.missions.recorded_policies import RecordedPolicies
from uav_collect.missions.rollout import fly, fly_for_metrics
from uav_collect.missions.simulation import fly_by_agents, Simulation
from uav_collect.scenario.model import Scenario
from uav_collect.scenario.site import build_site
from uav_collect.uav import lookahead
from uav_collect.uav.action_codes import FORWARD, N_ACTIONS, RIGHT
from uav_collect.uav.belief import Belief, belief_of, new_beliefs, observe
from uav_collect.uav.briefing import brief, Briefing
from uav_collect.uav.futures import (
    begin_future,
    draw_future,
    fly_future,
    Future,
    new_contacts,
    new_future,
    note_contacts,
)
from uav_collect.uav.heuristics import Heuristic, shares_for
from uav_collect.uav.moves import new_moves
from uav_collect.uav.policy import policy_for, policy_named, remarks
from uav_collect.uav.view import LocalView

SWEEP = int(Heuristic.SWEEP)
KNOWN = {'demand__known_empty': 'sensors'}  # where every sensor has data, all demand is known
CELLS = ((2, 4), (3, 2), (4, 4), (4, 2), (3, 1), (3, 3), (1, 1))  # column and row


def first_look(scenario: Scenario) -> tuple[Briefing, Belief, LocalView]:
    """What the first UAV knows as it decides first."""
    simulation = Simulation(build_site(scenario), 0)
    event = simulation.next_event()
    assert event is not None
    belief = belief_of(new_beliefs(simulation.briefing, 1), 0)
    observe(belief, simulation.briefing, event.view)
    return simulation.briefing, belief, event.view


def imagined(scenario: Scenario, first_action: int) -> Future:
    """The future that the first UAV imagines of an action at its first decision."""
    briefing, belief, view = first_look(scenario)
    future, contacts, shares = (
        new_future(briefing),
        new_contacts(briefing),
        shares_for(SWEEP, briefing),
    )
    draw_future(briefing, belief, future, 0, view.time_s, 0)
    begin_future(SWEEP, briefing, shares, 0, belief, view, new_row(1, 0), contacts, future)
    fly_future(SWEEP, briefing, shares, new_moves(briefing), 0, first_action, future)
    return future


@pytest.mark.parametrize('fleet', [[uav(5.0)], [uav(5.0), uav(10.0)]])
def test_where_all_demand_is_known_the_future_is_what_comes(
    fleet: list[dict[str, object]],
) -> None:
    scenario = tiny(*fleet, **KNOWN)
    log = fly(build_site(scenario), [0], 'sweep')[0]
    future = imagined(scenario, int(log.events['action'][0]))
    for index in range(len(fleet)):
        own = log.events[log.events['uav'] == index + 1]
        # But for hovers, of a second or so: their rate is a guess.
        assert future.end_s[index] == pytest.approx(
            own['time_s'][-1] + own['duration_s'][-1], abs=3.0
        )


def test_a_future_holds_what_was_seen_and_draws_the_rest_by_its_chance() -> None:
    briefing, belief, view = first_look(scenario_of(2))
    future, drawn = new_future(briefing), 0
    unseen = [
        cell for cell in range(100) if not belief.complete[cell] and not belief.seen_bit[cell]
    ]
    for number in range(20):
        draw_future(briefing, belief, future, 0, view.time_s, number)
        for cell in {*range(100)} - {*unseen}:
            assert future.drawn_bit[cell] == belief.seen_bit[cell]
        drawn += sum(future.drawn_bit[cell] > 0.0 for cell in unseen)
    assert drawn / len(unseen) / 20 == pytest.approx(briefing.data_chance, abs=0.04)


def test_the_expected_data_is_what_the_paper_draws() -> None:
    briefing = brief(scenario_of(2))
    assert briefing.data_chance == pytest.approx(0.3)
    # 3.7 sensors a cell, of .55 Mbit each, in 74 of 100 cells.
    assert briefing.cell_data_bit == pytest.approx(0.55e6 * 3.7 / 0.7425, rel=1e-3)
    assert 3e6 / 2 < briefing.upload_bps < 4e6


def test_who_was_heard_between_two_cells_flies_on_as_it_did() -> None:
    scenario = tiny()
    briefing, belief, view = first_look(scenario)
    contacts, future = new_contacts(briefing), new_future(briefing)
    belief.peer_x_m[1], belief.peer_y_m[1], belief.peer_s[1] = 40.0, 25.0, 1.5
    note_contacts(briefing, contacts, belief)
    begin_future(
        SWEEP,
        briefing,
        shares_for(SWEEP, briefing),
        0,
        belief,
        view._replace(time_s=2.0),
        new_row(1, 0),
        contacts,
        future,
    )
    assert (contacts.heading[1], future.action[1]) == (RIGHT, RIGHT)
    assert (future.x_m[1], future.y_m[1], future.end_s[1]) == (75.0, 25.0, 1.5 + 35.0 / 10.0)


def test_where_all_demand_is_known_it_flies_better_than_its_rule() -> None:
    places = [(25.0 + 50.0 * column, 25.0 + 50.0 * row, 0.5) for column, row in CELLS]
    site = build_site(tiny(sensors=places, area__cells_per_side=5, **KNOWN))
    by_rule, ahead = (fly_for_metrics(site, [0], name) for name in ('sweep', 'lookahead:sweep:2'))
    assert ahead.is_complete.all()
    assert ahead.energy_j.sum() < 0.95 * by_rule.energy_j.sum()


@pytest.mark.parametrize('policy', ['lookahead:sweep:3', 'lookahead:hert:2'])
def test_missions_agent_by_agent_have_the_same_bytes(policy: str) -> None:
    scenario = scenario_of(2, area__cells_per_side=4)
    site = build_site(scenario)
    together = fly(site, [1, 2], policy)
    alone = [
        fly_by_agents(site, seed, lambda: policy_for(policy, scenario), 'exact', GUARD_AFTER)
        for seed in (1, 2)
    ]
    assert [log.to_jsonl() for log in together] == [log.to_jsonl() for log in alone]
    assert together[0].header.uavs[0].policy == policy


def test_without_news_it_does_what_its_rule_does() -> None:
    briefing, belief, view = first_look(tiny(uav(5.0), fleet__default__energy_budget_kj=25.0))
    legal = new_row(N_ACTIONS, 0)
    legal[FORWARD] = legal[RIGHT] = 1
    rule, ahead = policy_named('random'), policy_named('lookahead:random:2')
    rule.begin(briefing, 0)
    ahead.begin(briefing, 0)
    is_alike = []
    for number in range(2 * GUARD_AFTER):
        now = view._replace(time_s=float(number))
        is_alike.append(ahead.choose(belief, now, legal) == rule.choose(belief, now, legal))
    assert not all(is_alike[:GUARD_AFTER])
    assert all(is_alike[GUARD_AFTER:])


@pytest.mark.parametrize(
    ('name', 'said'),
    [
        ('lookahead:strong', "looks ahead with 'strong': must be one of hert, hert-equal, sweep"),
        ('lookahead:', "looks ahead with '': must be one of hert"),
        ('lookahead:sweep:1', "'1' futures: must be a whole number from 2 to 1000"),
        ('lookahead:sweep:x', "'x' futures: must be"),
        ('lookahead:sweep:', "'' futures: must be"),
    ],
)
def test_other_names_are_refused(name: str, said: str) -> None:
    with pytest.raises(PolicyMismatchError, match=said) as raised:
        policy_named(name)
    assert '\n' not in str(raised.value)


def test_it_says_where_its_decisions_take_seconds(monkeypatch: pytest.MonkeyPatch) -> None:
    small, large = scenario_of(1, area__cells_per_side=4), scenario_of(1, area__cells_per_side=20)
    policy = policy_named('lookahead:sweep')
    for is_compiled in (True, False):
        monkeypatch.setattr(lookahead, 'kernels_are_compiled', lambda is_on=is_compiled: is_on)
        assert remarks(policy, small) == []
        assert len(remarks(policy, large)) == int(not is_compiled)


def test_it_may_be_chosen_as_the_best() -> None:
    candidates, _ = candidates_for(scenario_of(2), ['lookahead:sweep'])
    assert [it.name for it in candidates][-2:] == ['hert', 'lookahead:sweep']
    assert 20 <= planned_missions(candidates, 100, is_compiled=True) < 200


def test_a_recorded_mission_may_be_flown_again_by_it() -> None:
    site = build_site(scenario_of(1, area__cells_per_side=3))
    header = fly(site, [0], 'lookahead:sweep:2')[0].header
    member = RecordedPolicies().crew(header, site, {}).members[0]
    assert member is not None
    assert member.policy.name == 'lookahead:sweep:2'
