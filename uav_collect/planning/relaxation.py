"""What no plan can do better than: lower bounds on time and energy, by relaxing the routes.

Routes that serve all data cells, k of them, are together k ways from a start, k ways home, and
n - k ways between cells that close no circle, two ways at each cell. Without the last condition
the cheapest such ways are a spanning tree less its dearest edges, and the cheapest starts and
ends: no plan is cheaper. A price on each cell, paid for each way beyond the second and refunded
for each one missing, changes the cost of no plan; prices that make the bound high are searched
for. Half of a cell's hover is counted with each of its two ways.

Source: Held and Karp, "The Traveling-Salesman Problem and Minimum Spanning Trees", Operations
Research 18 (6), 1970; Polyak's step sizes.
"""

from typing import NamedTuple

from uav_collect.kernels.arrays import new_row, Row, row_of
from uav_collect.kernels.compile import kernel, long_kernel
from uav_collect.planning.problem import FAR, PlanProblem

_N_STEPS = 200  # prices tried
_PATIENCE = 8  # steps without a better bound before steps get shorter
_SHORTER = 0.7
_ROUNDING = 1e-9  # relative; keeps the bound below what rounding may make of it


class Charge(NamedTuple):
    """What relaxed routes cost, in weighted seconds or in joules."""

    flight: Row[float]  # (U,) cost of each UAV's seconds in flight
    hover: Row[float]  # (U,) and hovering
    idle: Row[float]  # (U,) of a UAV that only flies home, saved where it serves a cell
    base: float  # paid whatever is flown
    divisor: Row[float]  # (U,) of the cost of k routes, at k - 1; the least quotient counts


class _Prices(NamedTuple):
    """Rows of `relaxed_cost`, by data cell unless said otherwise."""

    price: Row[float]
    pair: Row[float]  # (n_cells * n_cells) cost of the way between two cells, without prices
    first: Row[float]  # of the cheapest start there
    last: Row[float]  # of the cheapest end there
    n_ways: Row[int]  # of the relaxed routes
    parent: Row[int]  # in the tree
    edge: Row[float]  # cost of the way to the parent
    key: Row[float]
    by_edge: Row[int]  # cells in ascending order of their edges
    by_first: Row[int]
    by_last: Row[int]


def least_completion_s(problem: PlanProblem, length_m: float, plan_s: float) -> float:
    """A time before which no fleet can have collected everything and be home.

    The latest UAV is home no sooner than any weighted mean of all. The weights are the rates at
    which the UAVs would do all the work alone, and sum, of k UAVs, to no more than the k largest.

    Args:
        length_m: of the way that the work takes, about; good weights come of it, any are valid.
        plan_s: completion time of a plan; steps are made to it.
    """
    if problem.n_cells == 0:
        return _direct_s(problem)
    hover_s = sum(problem.least_hover_s)
    rates = [1.0 / (length_m / speed_mps + hover_s) for speed_mps in problem.speed_mps]
    ranked = sorted(rates, reverse=True)
    charge = Charge(
        flight=row_of(rates),
        hover=row_of(rates),
        idle=new_row(problem.n_uavs, 0.0),
        base=0.0,
        divisor=row_of([sum(ranked[: n_routes + 1]) for n_routes in range(len(ranked))]),
    )
    return max(_direct_s(problem), _bound(problem, charge, plan_s))


def least_energy_j(problem: PlanProblem, plan_j: float) -> float:
    """An energy without which no fleet can collect everything and come home.

    Args:
        plan_j: energy of a plan; steps are made to it.
    """
    idle_j = [problem.flight_power_w[uav] * _idle_s(problem, uav) for uav in range(problem.n_uavs)]
    if problem.n_cells == 0:
        return sum(idle_j)
    charge = Charge(
        flight=problem.flight_power_w,
        hover=problem.hover_power_w,
        idle=row_of(idle_j),
        base=sum(idle_j),
        divisor=new_row(problem.n_uavs, 1.0),
    )
    return _bound(problem, charge, plan_j)


def _idle_s(problem: PlanProblem, uav: int) -> float:
    """How long a UAV flies straight home from its start."""
    n_points = problem.n_cells + 2 * problem.n_uavs
    start = problem.n_cells + uav
    return problem.way_m[start * n_points + start + problem.n_uavs] / problem.speed_mps[uav]


def _direct_s(problem: PlanProblem) -> float:
    """How long the remotest cell takes by itself, and the way home of those that do nothing."""
    n_cells, n_uavs = problem.n_cells, problem.n_uavs
    n_points = n_cells + 2 * n_uavs
    latest_s = max(_idle_s(problem, uav) for uav in range(n_uavs))
    for cell in range(n_cells):
        alone_s = []
        for uav in range(n_uavs):
            start = cell * n_points + n_cells + uav
            length_m = problem.way_m[start] + problem.way_m[start + n_uavs]
            alone_s.append(length_m / problem.speed_mps[uav])
        latest_s = max(latest_s, min(alone_s) + problem.least_hover_s[cell])
    return latest_s * (1.0 - _ROUNDING)


def _bound(problem: PlanProblem, charge: Charge, plan_cost: float) -> float:
    size = problem.n_cells
    floats = [new_row(size, 0.0) for _ in range(5)]
    orders = [new_row(size, 0) for _ in range(3)]
    for order in orders:
        for index in range(size):
            order[index] = index
    prices = _Prices(
        price=floats[0],
        pair=new_row(size * size, 0.0),
        first=floats[1],
        last=floats[2],
        n_ways=new_row(size, 0),
        parent=new_row(size, 0),
        edge=floats[3],
        key=floats[4],
        by_edge=orders[0],
        by_first=orders[1],
        by_last=orders[2],
    )
    return climb(problem, charge, prices, plan_cost) * (1.0 - _ROUNDING)


@long_kernel
def climb(problem: PlanProblem, charge: Charge, prices: _Prices, plan_cost: float) -> float:
    """The highest bound that is found; the prices start at 0."""
    _write_costs(problem, charge, prices)
    highest, stride, n_idle = -FAR, 1.0, 0
    for _ in range(_N_STEPS):
        bound, n_routes = relaxed_cost(problem, charge, prices)
        n_idle += 1
        if bound > highest:
            highest = bound
            n_idle = 0
        if n_idle == _PATIENCE:
            stride *= _SHORTER
            n_idle = 0
        wrong = 0
        for cell in range(problem.n_cells):
            wrong += (prices.n_ways[cell] - 2) * (prices.n_ways[cell] - 2)
        if wrong == 0 or bound >= plan_cost:
            break
        step = stride * (plan_cost - bound) * charge.divisor[n_routes - 1] / wrong
        for cell in range(problem.n_cells):
            prices.price[cell] += step * (prices.n_ways[cell] - 2)
    return highest


@kernel
def _write_costs(problem: PlanProblem, charge: Charge, prices: _Prices) -> None:
    """Write what each way costs the UAV for which it is cheapest."""
    n_cells, n_uavs = problem.n_cells, problem.n_uavs
    n_points = n_cells + 2 * n_uavs
    for cell in range(n_cells):
        half_s = 0.5 * problem.least_hover_s[cell]
        prices.first[cell], prices.last[cell] = FAR, FAR
        for other in range(n_cells):
            prices.pair[cell * n_cells + other] = FAR
        for uav in range(n_uavs):
            per_m = charge.flight[uav] / problem.speed_mps[uav]
            row = cell * n_points
            hover = charge.hover[uav] * half_s
            start, home = row + n_cells + uav, row + n_cells + n_uavs + uav
            first = per_m * problem.way_m[start] + hover - charge.idle[uav]
            prices.first[cell] = min(prices.first[cell], first)
            last = per_m * problem.way_m[home] + hover
            prices.last[cell] = min(prices.last[cell], last)
            for other in range(n_cells):
                pair = per_m * problem.way_m[row + other] + hover
                pair += charge.hover[uav] * 0.5 * problem.least_hover_s[other]
                place = cell * n_cells + other
                prices.pair[place] = min(prices.pair[place], pair)


@kernel
def relaxed_cost(problem: PlanProblem, charge: Charge, prices: _Prices) -> tuple[float, int]:
    """The bound that the prices give, and with how many routes; writes `n_ways`."""
    n_cells = problem.n_cells
    tree = _grow(n_cells, prices)
    total = charge.base + tree
    for cell in range(n_cells):
        total -= 2.0 * prices.price[cell]
    # The root, cell 0, has no edge: it comes first and is never dropped.
    _sort(prices, prices.by_edge, prices.edge, 0.0)
    _sort(prices, prices.by_first, prices.first, 1.0)
    _sort(prices, prices.by_last, prices.last, 1.0)
    least, best = FAR, 1
    for n_routes in range(1, min(problem.n_uavs, n_cells) + 1):
        first, last = prices.by_first[n_routes - 1], prices.by_last[n_routes - 1]
        total += prices.first[first] + prices.price[first]
        total += prices.last[last] + prices.price[last]
        if n_routes > 1:
            total -= prices.edge[prices.by_edge[n_cells - n_routes + 1]]
        if total / charge.divisor[n_routes - 1] < least:
            least = total / charge.divisor[n_routes - 1]
            best = n_routes
    _count_ways(n_cells, prices, best)
    return least, best


@kernel
def _grow(n_cells: int, prices: _Prices) -> float:
    """Write the cheapest spanning tree with prices (Prim); its cost."""
    price, pair, edge = prices.price, prices.pair, prices.edge
    for cell in range(n_cells):
        edge[cell] = FAR
        prices.parent[cell] = -1
        prices.n_ways[cell] = 0  # for now: 1 once it is in the tree
    tree, newest = 0.0, 0
    prices.n_ways[0] = 1
    for _ in range(n_cells - 1):
        least, nearest = FAR, 0
        row = newest * n_cells
        for cell in range(n_cells):
            if prices.n_ways[cell] == 0:
                cost = pair[row + cell] + price[newest] + price[cell]
                if cost < edge[cell]:
                    edge[cell] = cost
                    prices.parent[cell] = newest
                if edge[cell] < least:
                    least, nearest = edge[cell], cell
        newest = nearest
        prices.n_ways[newest] = 1
        tree += least
    edge[0] = -FAR
    return tree


@kernel
def _sort(prices: _Prices, order: Row[int], cost: Row[float], price_weight: float) -> None:
    """Bring cells into ascending order of a cost; quick where they nearly are."""
    for cell in range(len(order)):
        prices.key[cell] = cost[cell] + price_weight * prices.price[cell]
    for index in range(1, len(order)):
        cell = order[index]
        place = index
        while place > 0 and prices.key[order[place - 1]] > prices.key[cell]:
            order[place] = order[place - 1]
            place -= 1
        order[place] = cell


@kernel
def _count_ways(n_cells: int, prices: _Prices, n_routes: int) -> None:
    for cell in range(n_cells):
        prices.n_ways[cell] = 0
    for index in range(1, n_cells - n_routes + 1):
        cell = prices.by_edge[index]
        prices.n_ways[cell] += 1
        prices.n_ways[prices.parent[cell]] += 1
    for index in range(n_routes):
        prices.n_ways[prices.by_first[index]] += 1
        prices.n_ways[prices.by_last[index]] += 1
