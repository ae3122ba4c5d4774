"""Looks for the best plan of a fleet that knows all demand: ruin and recreate, over and over.

Some neighbouring points are taken out of the routes and put back where they cost least; what comes
out is kept if it is better, or worse by no more than a falling temperature allows.

Source: Christiaens and Vanden Berghe, "Slack Induction by String Removals for Vehicle Routing
Problems", Transportation Science 54 (2), 2020.
"""

import math
from typing import NamedTuple

from uav_collect.kernels.arrays import new_row, Row
from uav_collect.kernels.compile import kernel, long_kernel
from uav_collect.planning.problem import FAR, PlanProblem

_MEAN_REMOVED = 8.0  # points taken out at once, on average
_LONGEST_STRING = 10  # points of one route taken out at once
_STRICT = 0.2  # how often points are put back by the aim alone
_BLINK = 0.01  # how often a place is overlooked, so that the same ruin can be rebuilt otherwise
_OVERLOOK = 0.02  # how often one of several UAVs is
_FIRST_TEMPERATURE = 6.0  # times the first plan's mean cost of a point
_LAST_TEMPERATURE = 0.01  # of the first one
_OVERSPENT = 1e3  # cost of a joule beyond a UAV's allowance, above any time or energy saved
_DONE = -1  # as a route's mark: it has already lost a string


class Aim(NamedTuple):
    """What a plan is to keep small: a weighted sum, in seconds or in joules."""

    latest: float  # weight of the time when the last UAV is home
    flight: Row[float]  # (U,) weight of each UAV's seconds in flight
    hover: Row[float]  # (U,) and hovering


class Routes(NamedTuple):
    """The route of each UAV as a chain of points from its start to its home; rows by point."""

    after: Row[int]  # (N,) the next point
    before: Row[int]  # (N,)
    uav: Row[int]  # (N,) whose route it is in; of a start also _DONE
    length_m: Row[float]  # (U,)
    hover_s: Row[float]  # (U,)


class Loose(NamedTuple):
    """Points taken out of their routes, to be put back."""

    point: Row[int]  # (n_cells,) or fewer
    key: Row[float]  # they are put back in ascending order of it


def new_routes(problem: PlanProblem) -> Routes:
    """Room for the routes of a problem, which `search` writes."""
    n_points = problem.n_cells + 2 * problem.n_uavs
    return Routes(
        after=new_row(n_points, 0),
        before=new_row(n_points, 0),
        uav=new_row(n_points, 0),
        length_m=new_row(problem.n_uavs, 0.0),
        hover_s=new_row(problem.n_uavs, 0.0),
    )


def best_routes(problem: PlanProblem, aim: Aim, steer: Aim, n_rounds: int) -> Routes:
    """The best routes found in a number of rounds; the same for the same arguments.

    Where no plan within the allowances is found, the routes overspend.

    Args:
        aim: by which routes are the best.
        steer: what the search goes by; may tell apart what the aim does not.
        n_rounds: how often routes are ruined and recreated.
    """
    best, n_cells = new_routes(problem), problem.n_cells
    loose = Loose(point=new_row(n_cells, 0), key=new_row(n_cells, 0.0))
    routes, kept, state = new_routes(problem), new_routes(problem), new_row(1, 1)
    search(problem, aim, steer, n_rounds, routes, kept, best, loose, state)
    return best


@long_kernel
def search(
    problem: PlanProblem,
    aim: Aim,
    steer: Aim,
    n_rounds: int,
    routes: Routes,
    kept: Routes,
    best: Routes,
    loose: Loose,
    state: Row[int],
) -> None:
    """Ruin and recreate routes round after round; the best ones are kept in `best`.

    Args:
        aim, steer, n_rounds: as for `best_routes`.
        routes: changed in every round, shapes as all routes.
        kept: what the next round starts from.
        best: written.
        loose: scratch.
        state: (1,) of the random numbers.
    """
    _begin(problem, routes)
    for point in range(problem.n_cells):
        loose.point[point] = point
    _put_back(problem, steer, routes, loose, problem.n_cells, state)
    _copy(routes, kept)
    _copy(routes, best)
    best_cost = _cost(problem, aim, routes, -1, 0.0, 0.0)
    kept_cost = _cost(problem, steer, routes, -1, 0.0, 0.0)
    temperature = _FIRST_TEMPERATURE * kept_cost / max(problem.n_cells, 1)
    cooling = math.exp(math.log(_LAST_TEMPERATURE) / max(n_rounds, 1))
    for _ in range(n_rounds if problem.n_cells > 0 else 0):
        n_loose = _take_out(problem, routes, loose, state)
        by = aim if _draw(state) < _STRICT else steer
        _put_back(problem, by, routes, loose, n_loose, state)
        cost = _cost(problem, aim, routes, -1, 0.0, 0.0)
        if cost < best_cost:
            best_cost = cost
            _copy(routes, best)
        cost = _cost(problem, steer, routes, -1, 0.0, 0.0)
        if cost < kept_cost - temperature * math.log(_draw(state) + 1e-9):
            kept_cost = cost
            _copy(routes, kept)
        else:
            _copy(kept, routes)
        temperature *= cooling


@kernel
def _draw(state: Row[int]) -> float:
    """A number in [0, 1), from a linear congruential generator of 31 bits.

    A plan needs half a million; a keyed draw takes 20 us where kernels are interpreted.
    """
    state[0] = (state[0] * 1103515245 + 12345) & 0x7FFFFFFF
    return (state[0] >> 8) / 8388608.0


@kernel
def _begin(problem: PlanProblem, routes: Routes) -> None:
    n_cells, n_uavs = problem.n_cells, problem.n_uavs
    n_points = n_cells + 2 * n_uavs
    for uav in range(n_uavs):
        start, home = n_cells + uav, n_cells + n_uavs + uav
        routes.after[start], routes.before[home] = home, start
        routes.uav[start], routes.uav[home] = uav, uav
        routes.length_m[uav] = problem.way_m[start * n_points + home]
        routes.hover_s[uav] = 0.0


@kernel
def _copy(routes: Routes, other: Routes) -> None:
    for point in range(len(routes.after)):
        other.after[point] = routes.after[point]
        other.before[point] = routes.before[point]
        other.uav[point] = routes.uav[point]
    for uav in range(len(routes.length_m)):
        other.length_m[uav] = routes.length_m[uav]
        other.hover_s[uav] = routes.hover_s[uav]


@kernel
def _cost(
    problem: PlanProblem, aim: Aim, routes: Routes, changed: int, more_m: float, more_s: float
) -> float:
    """The cost of the routes, the one of a UAV being longer by a way and a hover; -1: none is."""
    latest_s = 0.0
    cost = 0.0
    for uav in range(problem.n_uavs):
        length_m, hover_s = routes.length_m[uav], routes.hover_s[uav]
        if uav == changed:
            length_m += more_m
            hover_s += more_s
        flight_s = length_m / problem.speed_mps[uav]
        latest_s = max(latest_s, flight_s + hover_s)
        cost += aim.flight[uav] * flight_s + aim.hover[uav] * hover_s
        energy_j = problem.flight_power_w[uav] * flight_s + problem.hover_power_w[uav] * hover_s
        cost += _OVERSPENT * max(energy_j - problem.allowance_j[uav], 0.0)
    return aim.latest * latest_s + cost


@kernel
def _n_served(problem: PlanProblem, routes: Routes, uav: int) -> int:
    n_served = 0
    point = routes.after[problem.n_cells + uav]
    while point < problem.n_cells:
        n_served += 1
        point = routes.after[point]
    return n_served


@kernel
def _take_out(problem: PlanProblem, routes: Routes, loose: Loose, state: Row[int]) -> int:
    """Take strings of neighbouring points out of routes near a random point; how many points."""
    n_cells = problem.n_cells
    longest = 0
    for uav in range(problem.n_uavs):
        longest = max(longest, _n_served(problem, routes, uav))
    longest = min(longest, _LONGEST_STRING)
    n_strings = int(_draw(state) * (4.0 * _MEAN_REMOVED / (1.0 + longest) - 1.0) + 1.0)
    centre = int(_draw(state) * n_cells)
    n_loose = 0
    for near in range(n_cells):
        if n_strings == 0:
            break
        point = problem.nearest[centre * n_cells + near]
        uav = routes.uav[point]
        if uav < 0 or routes.uav[n_cells + uav] == _DONE:
            continue
        n_strings -= 1
        routes.uav[n_cells + uav] = _DONE
        size = int(_draw(state) * min(_n_served(problem, routes, uav), longest)) + 1
        for _ in range(int(_draw(state) * size)):
            if routes.before[point] < n_cells:
                point = routes.before[point]
        while size > 0 and point < n_cells:
            follower = routes.after[point]
            _unlink(problem, routes, uav, point)
            loose.point[n_loose] = point
            n_loose += 1
            size -= 1
            point = follower
    for uav in range(problem.n_uavs):
        routes.uav[n_cells + uav] = uav
    return n_loose


@kernel
def _unlink(problem: PlanProblem, routes: Routes, uav: int, point: int) -> None:
    n_points = problem.n_cells + 2 * problem.n_uavs
    way_m, before, after = problem.way_m, routes.before[point], routes.after[point]
    detour_m = way_m[before * n_points + point] + way_m[point * n_points + after]
    routes.length_m[uav] -= detour_m - way_m[before * n_points + after]
    routes.hover_s[uav] -= problem.hover_s[uav * problem.n_cells + point]
    routes.after[before], routes.before[after] = after, before
    routes.uav[point] = -1


@kernel
def _put_back(
    problem: PlanProblem, steer: Aim, routes: Routes, loose: Loose, n_loose: int, state: Row[int]
) -> None:
    """Put loose points back, one after the other, each where it costs least."""
    _sort(problem, loose, n_loose, state)
    n_cells = problem.n_cells
    for index in range(n_loose):
        point = loose.point[index]
        least, taker, place, longer_m = FAR, 0, n_cells, 0.0
        # Two points may belong with a UAV that neither would go to by itself.
        draw = _draw(state) if problem.n_uavs > 1 else 1.0
        overlooked = int(draw / _OVERLOOK * problem.n_uavs)
        for uav in range(problem.n_uavs):
            if uav == overlooked:
                continue
            at, detour_m = _place(problem, routes, uav, point, state)
            hover_s = problem.hover_s[uav * n_cells + point]
            cost = _cost(problem, steer, routes, uav, detour_m, hover_s)
            if cost < least:
                least, taker, place, longer_m = cost, uav, at, detour_m
        after = routes.after[place]
        routes.after[place], routes.before[point] = point, place
        routes.after[point], routes.before[after] = after, point
        routes.uav[point] = taker
        routes.length_m[taker] += longer_m
        routes.hover_s[taker] += problem.hover_s[taker * n_cells + point]


@kernel
def _place(
    problem: PlanProblem, routes: Routes, uav: int, point: int, state: Row[int]
) -> tuple[int, float]:
    """After which point of a route another one costs the shortest detour, and that detour [m]."""
    n_points = problem.n_cells + 2 * problem.n_uavs
    way_m, after, row = problem.way_m, routes.after, point * n_points
    here = problem.n_cells + uav
    home = here + problem.n_uavs
    place = here
    least_m = way_m[row + here] + way_m[row + after[here]] - way_m[here * n_points + after[here]]
    here = after[here]
    while here != home:
        there = after[here]
        detour_m = way_m[row + here] + way_m[row + there] - way_m[here * n_points + there]
        if detour_m < least_m and _draw(state) >= _BLINK:
            least_m = detour_m
            place = here
        here = there
    return place, least_m


@kernel
def _sort(problem: PlanProblem, loose: Loose, n_loose: int, state: Row[int]) -> None:
    """Bring loose points into an order: at random, or the farthest, nearest or longest first."""
    n_cells = problem.n_cells
    n_points = n_cells + 2 * problem.n_uavs
    kind = _draw(state)
    for index in range(n_loose):
        point = loose.point[index]
        away_m = problem.way_m[n_cells * n_points + point]  # from the first UAV's start
        if kind < 0.4:
            loose.key[index] = _draw(state)
        elif kind < 0.7:
            loose.key[index] = -away_m
        elif kind < 0.85:
            loose.key[index] = away_m
        else:
            loose.key[index] = -problem.hover_s[point]
    for index in range(1, n_loose):
        key, point = loose.key[index], loose.point[index]
        place = index
        while place > 0 and loose.key[place - 1] > key:
            loose.key[place] = loose.key[place - 1]
            loose.point[place] = loose.point[place - 1]
            place -= 1
        loose.key[place] = key
        loose.point[place] = point
