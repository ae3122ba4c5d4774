"""What no plan can beat that knows all demand but must see every cell, as a policy must.

A map is complete only once somebody has seen each cell. So a plan also comes past each cell that
no data cell shows: it flies over one of those that show it, at least. Over which, is tried: as
many relaxed plans as there are choices, each with one more cell to fly over. No plan is better
than the best of them. That one is split again, by the next cell to be seen.
"""

from collections.abc import Sequence
from functools import partial
from heapq import heappop, heappush

import numpy as np
from uav_collect.kernels.arrays import Floats, row_of
from uav_collect.planning.problem import PlanProblem, ways_m
from uav_collect.planning.relaxation import least_energy_j
from uav_collect.uav.briefing import Briefing
from uav_collect.uav.open_ways import OpenCells

N_SPLITS = 12
_TARGET = 1.03  # of the energy of a plan that need not see every cell; steps are made to it


def least_seeing_energy_j(
    briefing: Briefing, problem: PlanProblem, plan_j: float, n_splits: int = N_SPLITS
) -> float:
    """An energy without which no fleet can collect everything, see every cell and come home.

    Args:
        plan_j: energy of a plan; steps are made to it.
        n_splits: with more of them the bound may come nearer to what is possible.
    """
    every = [cell for cell, is_open in enumerate(problem.is_open) if is_open]
    way_m = ways_m(briefing, np.array(every, dtype=np.int64))
    index_of = {cell: index for index, cell in enumerate(every)}
    stops = [[index_of[cell] for cell in region] for region in _stops(briefing, problem)]
    data = [index_of[int(cell)] for cell in problem.cell]
    bound_over = partial(_bound_over, problem, way_m, data, _TARGET * plan_j)
    lowest_j = least_energy_j(problem, plan_j)
    # What the cells to be seen cost by themselves: the dearest are split by first.
    alone_j = [min(bound_over([cell]) for cell in stop) for stop in stops]
    order = sorted(range(len(stops)), key=lambda stop: -alone_j[stop])
    nodes: list[tuple[float, list[int]]] = [(lowest_j, [])]
    for _ in range(n_splits):
        bound_j, over = nodes[0]
        left = [stops[stop] for stop in order if not set(stops[stop]) & set(over)]
        if not left:
            break
        heappop(nodes)
        for cell in left[0]:
            heappush(nodes, (max(bound_j, bound_over([*over, cell])), [*over, cell]))
    return nodes[0][0]


def _stops(briefing: Briefing, problem: PlanProblem) -> list[list[int]]:
    """For each cell that no data cell and no start shows, the cells that it is seen from."""
    n_rows = len(problem.is_open) // problem.n_columns
    area = OpenCells(n_rows, problem.n_columns, problem.is_open)
    shown = {int(cell) for cell in (*problem.cell, *problem.start_cell)}
    cells = [cell for cell, is_open in enumerate(problem.is_open) if is_open]
    regions = [area.region(cell) for cell in cells if not briefing.known_complete[cell]]
    return [region for region in regions if shown.isdisjoint(region)]


def _bound_over(
    problem: PlanProblem, way_m: Floats, data: list[int], target_j: float, over: Sequence[int]
) -> float:
    """The least energy of plans that also fly over some cells, by index among the open ones."""
    n_open = len(way_m) - 2 * problem.n_uavs
    points = [*data, *over, *range(n_open, len(way_m))]
    n_cells, n_over = problem.n_cells + len(over), len(over)
    wider = problem._replace(
        n_cells=n_cells,
        way_m=row_of(way_m[np.ix_(points, points)].ravel().tolist()),
        least_hover_s=row_of([*map(float, problem.least_hover_s), *[0.0] * n_over]),
    )
    return float(least_energy_j(wider, target_j))
