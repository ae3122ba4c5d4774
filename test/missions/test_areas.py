"""Missions over areas that are not squares, some of whose cells are closed.

  north
2 . . . . .     3 x 5 cells of 50 m; x is closed. Each + has a sensor; both UAVs start and
1 + x x . +     land in the south-west cell.
0 0 . . + .
  0 1 2 3 4
"""

import math

import numpy as np
import pytest
from tiny_world import Flight, MOVE_5_J, tiny, uav
from uav_collect.analysis.metrics import mission_metrics
from uav_collect.missions.flight_samples import FlightSampler
from uav_collect.missions.rollout import fly
from uav_collect.missions.simulation import Event, fly_by_agents
from uav_collect.recording.mission_log import from_jsonl
from uav_collect.scenario.model import Scenario
from uav_collect.scenario.site import build_site
from uav_collect.uav.action_codes import BY_POLICY, HOME, HOVER
from uav_collect.uav.actions import home_duration_s, home_way_m
from uav_collect.uav.briefing import brief
from uav_collect.uav.heuristics import Heuristic, RulePolicy
from uav_collect.uav.messages import Decision

SENSORS = [(25.0, 75.0, 1.0), (175.0, 25.0, 0.5), (225.0, 75.0, 0.25)]
CLOSED = 6, 7


def field(**overrides: object) -> Scenario:
    values: dict[str, object] = {
        'area__rows': 3,
        'area__columns': 5,
        'area__no_fly': [[[60.0, 60.0], [140.0, 60.0], [140.0, 90.0]]],
    }
    return tiny(uav(5.0), uav(10.0), sensors=SENSORS, **(values | overrides))


@pytest.mark.parametrize('heuristic', Heuristic)
def test_agents_and_a_batch_fly_the_same_mission_around_closed_cells(
    heuristic: Heuristic,
) -> None:
    site = build_site(field(fleet__uavs=[uav(5.0, energy_budget_kj=30.0)] * 2))
    [log] = fly(site, [3], lambda: RulePolicy(heuristic), 'exact', 0)
    alone = fly_by_agents(site, 3, lambda: RulePolicy(heuristic), 'exact', 0)
    assert log.to_jsonl() == alone.to_jsonl()
    cells = (log.events['y_m'] // 50.0) * 5 + log.events['x_m'] // 50.0
    assert not np.isin(cells, CLOSED).any()
    assert len(np.unique(cells)) > 3


def homebound() -> tuple[Flight, Event]:
    """A UAV at 5 m/s that turns home at cell 12, behind the closed ones."""
    flight = Flight(field(fleet__uavs=[uav(5.0, start=(2, 2), home_m=(25.0, 25.0))]))
    event = flight.look()
    flight.simulation.start(event, Decision(action=HOME, reason=BY_POLICY))
    return flight, event


def test_a_uav_flies_home_around_closed_cells() -> None:
    flight, _ = homebound()
    briefing, world = flight.simulation.briefing, flight.simulation
    corners_m = [(125.0, 125.0), (25.0, 125.0), (25.0, 25.0)]
    assert [*home_way_m(briefing, 0, corners_m[0])] == corners_m
    assert briefing.home_m[12] == 200.0
    assert home_duration_s(briefing, 0, 125.0, 125.0) == world.end_s == 40.0
    assert world.leg(0).length_m == 200.0
    assert world.energy_used_j == pytest.approx(4 * MOVE_5_J, rel=1e-6)
    for time_s, place_m in (
        (0.0, corners_m[0]), (10.0, (75.0, 125.0)), (20.0, corners_m[1]), (30.0, (25.0, 75.0)),
        (40.0, corners_m[2]), (49.0, corners_m[2]),
    ):  # fmt: skip
        assert world.position_m(0, time_s) == pytest.approx(place_m)
    assert world.turns(0, 19.0) == []
    assert world.turns(0, 40.0) == [(20.0, corners_m[1])]


def test_uavs_are_in_contact_where_a_way_home_leads() -> None:
    homes = uav(5.0, start=(2, 2), home_m=(25.0, 25.0)), uav(5.0, start=(2, 0))
    flight = Flight(field(fleet__uavs=[*homes], radio__contact_range_m=20.0))
    world, event = flight.simulation, flight.look()
    world.start(event, Decision(action=HOME, reason=BY_POLICY))
    found = [time_s for time_s in range(0, 40, 2) if world.contacts(0, time_s)]
    assert found == [16, 18, 20, 22, 24]


def test_samples_and_path_of_a_way_home_turn_where_it_turns() -> None:
    flight, event = homebound()
    sampler = FlightSampler(flight.simulation)
    sampler.note_event(event)
    for time_s, heading_rad in ((15.0, math.pi), (25.0, -math.pi / 2.0)):
        sample = sampler.sample(0, time_s)
        assert sample.speed_mps == pytest.approx(5.0)
        assert sample.heading_rad == pytest.approx(heading_rad)
    corners = [(it.time_s, it.x_m, it.y_m) for it in sampler.path(0, 25.0)]
    assert corners == [(0.0, 125.0, 125.0), (20.0, 25.0, 125.0), (25.0, 25.0, 100.0)]


@pytest.mark.parametrize('budget_kj', [6.0, 9.0, 13.0])
def test_the_reserve_of_a_uav_pays_for_its_way_around(budget_kj: float) -> None:
    scenario = field(fleet__uavs=[uav(5.0, energy_budget_kj=budget_kj)])
    [log] = fly(build_site(scenario), [1], lambda: RulePolicy(Heuristic.SWEEP), 'exact', 0)
    last, briefing = log.events[-1], brief(scenario)
    assert mission_metrics(log).is_safe
    assert last['duration_s'] == home_duration_s(briefing, 0, last['x_m'], last['y_m'])


def test_cells_that_all_know_to_be_empty_are_complete_from_the_start() -> None:
    site = build_site(field(demand__known_empty='sensors'))
    [log] = fly(site, [3], lambda: RulePolicy(Heuristic.SWEEP), 'exact', 0)
    alone = fly_by_agents(site, 3, lambda: RulePolicy(Heuristic.SWEEP), 'exact', 0)
    assert log.to_jsonl() == alone.to_jsonl()
    assert log.events['known_complete'][0] == 12
    assert log.events['collected_bit'].sum() == pytest.approx(1.75e6)


def test_a_uav_above_the_only_sensor_hovers_and_flies_home() -> None:
    above = tiny(
        uav(5.0, start=(1, 0)), sensors=[(25.0, 75.0, 1.0)], demand__known_empty='sensors'
    )
    [log] = fly(build_site(above), [3], lambda: RulePolicy(Heuristic.HERT), 'exact', 0)
    assert log.events['action'].tolist() == [HOVER, HOME]


def test_a_log_says_how_many_rows_and_columns_the_area_has() -> None:
    [log] = fly(build_site(field()), [3], lambda: RulePolicy(Heuristic.SWEEP), 'exact', 0)
    text = log.to_jsonl()
    assert b'"mission_seed": 3, "rows": 3, "columns": 5, "cell_size_m": 50.0' in text
    assert from_jsonl(text).to_jsonl() == text
    assert (log.header.n_rows, log.header.n_columns) == (3, 5)


def test_closed_cells_count_as_complete_from_the_start() -> None:
    [log] = fly(build_site(field()), [3], lambda: RulePolicy(Heuristic.SWEEP), 'exact', 0)
    # Of the four cells about the start one has data, one is closed; it knows of the other one.
    assert log.events['known_complete'][0] == 2 + len(CLOSED)
    assert log.events['known_complete'][-1] == 15
    assert log.events['collected_bit'].sum() == pytest.approx(1.75e6)
