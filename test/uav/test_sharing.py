"""How a fleet shares its tour: everything is somebody's, by speed, and found once."""

from collections.abc import Sequence
from itertools import pairwise

import odd_areas
import pytest
from uav_collect.scenario.load import load
from uav_collect.scenario.model import Scenario
from uav_collect.uav.briefing import brief, Briefing
from uav_collect.uav.sharing import shared_tour, SharedTour, shares_of
from uav_collect.uav.tour import TourKind

FLEETS_MPS = ([10.0], [10.0, 18.0], [18.0, 10.0, 5.0], [5.0, 10.0, 7.5, 12.0])


def fleet(speeds_mps: Sequence[float]) -> list[dict[str, float]]:
    return [{'speed_mps': speed_mps} for speed_mps in speeds_mps]


def pipeline(speeds_mps: Sequence[float], range_m: float = 200.0) -> Scenario:
    return odd_areas.pipeline(31, fleet__uavs=fleet(speeds_mps), radio__contact_range_m=range_m)


def places(shared: SharedTour, uav: int) -> set[int]:
    piece, n_places = shared.pieces[uav], len(shared.tour.stop)
    return {(piece.anchor + piece.direction * number) % n_places for number in range(piece.n_own)}


@pytest.mark.parametrize('speeds_mps', FLEETS_MPS)
def test_each_place_of_a_short_tour_is_one_uavs(speeds_mps: list[float]) -> None:
    for scenario in (pipeline(speeds_mps), odd_areas.with_a_hole(fleet__uavs=fleet(speeds_mps))):
        shared = shared_tour(brief(scenario))
        assert shared.tour.kind != TourKind.LANES
        pieces = [places(shared, uav) for uav in range(len(speeds_mps))]
        assert set.union(*pieces) == {*range(len(shared.tour.stop))}
        assert sum(map(len, pieces)) == len(shared.tour.stop)


@pytest.mark.parametrize('range_m', [0.0, 200.0])
@pytest.mark.parametrize('side', [1, 2, 3, 4, 7, 10])
@pytest.mark.parametrize('speeds_mps', FLEETS_MPS)
def test_each_place_of_lanes_is_somebodys(
    speeds_mps: list[float], side: int, range_m: float
) -> None:
    values = {'fleet.uavs': fleet(speeds_mps), 'radio.contact_range_m': range_m}
    shared = shared_tour(brief(load('paper_10x10', {**values, 'area.cells_per_side': side})))
    assert shared.tour.kind == TourKind.LANES
    pieces = [places(shared, uav) for uav in range(len(speeds_mps))]
    assert set.union(*pieces) == {*range(len(shared.tour.stop))}


def test_uavs_part_where_all_is_known_and_their_energy_lasts() -> None:
    def parts(**overrides: object) -> bool:
        return shared_tour(brief(odd_areas.pipeline(31, **overrides))).parts

    assert parts()
    assert not parts(fleet__uavs=fleet([18.0]))  # it has nobody to wait for
    assert not parts(demand__known_empty='none')  # nobody knows what is left
    assert not parts(faults=[{'uav': 'any', 'kind': 'gone', 'at_s': 60.0, 'share': 0.1}])
    assert not parts(fleet__default__energy_budget_kj=70.0)  # the faster one would spend 57 kJ


def test_where_uavs_part_the_fastest_has_what_time_allows() -> None:
    shared = shared_tour(brief(pipeline([10.0, 18.0])))
    slow, fast = shared.pieces
    assert fast.n_own > 5 * slow.n_own
    assert (slow.direction, fast.direction) == (1, -1)


def test_more_uavs_are_home_no_later() -> None:
    planned_s = [
        shared_tour(brief(pipeline([10.0] * n_uavs))).planned_s for n_uavs in (1, 2, 3, 4)
    ]
    assert all(more_s <= fewer_s for fewer_s, more_s in pairwise(planned_s))


def test_the_ways_of_a_briefing_are_found_once() -> None:
    scenario = pipeline([10.0, 18.0])
    one, other = brief(scenario), brief(scenario)
    assert one is not other
    assert shares_of(one) is shares_of(other)


def test_where_nothing_needs_a_visit_there_is_no_tour() -> None:
    briefing: Briefing = brief(pipeline([10.0, 18.0]))
    shares = shares_of(briefing._replace(known_complete=[1] * len(briefing.is_open)))
    assert (shares.n_places, len(shares.order)) == (0, 0)
