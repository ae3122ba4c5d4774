"""Measures the search for the shortest plan, beside OR-tools' routing where that is installed.

python bench/bound.py [MISSIONS [SOLUTIONS]]

OR-tools is no requirement: it insists on another protobuf than the one that is pinned. To compare,
install it into an environment of its own, over requirements/run.txt: ortools==9.15.6755.
"""

import importlib.util
from itertools import pairwise
import os
import sys
import time

import numpy as np
from rich.console import Console
from rich.table import Table
from uav_collect.planning import bound
from uav_collect.planning.problem import PlanProblem, problem_of
from uav_collect.scenario.load import load
from uav_collect.scenario.site import build_site

SCENARIO = 'paper_10x10'
TICKS_PER_S = 10_000  # OR-tools counts in whole numbers
SPAN_WEIGHT = 1_000  # of the latest UAV's time; each UAV's own weighs its part of the speeds


def completion_s(problem: PlanProblem, routes: list[list[int]]) -> float:
    """When the last UAV is home, each flying over its points."""
    return max(
        sum(leg_s(problem, uav, here, there) for here, there in pairwise(route))
        for uav, route in enumerate(routes)
    )


def leg_s(problem: PlanProblem, uav: int, here: int, there: int) -> float:
    """The hover at a point, and the way to another."""
    n_points = problem.n_cells + 2 * problem.n_uavs
    hover_s = problem.hover_s[uav * problem.n_cells + here] if here < problem.n_cells else 0.0
    return hover_s + problem.way_m[here * n_points + there] / problem.speed_mps[uav]


def by_ortools(problem: PlanProblem, n_solutions: int) -> float:
    """The shortest plan by OR-tools: guided local search from parallel insertion [s]."""
    from ortools.constraint_solver import pywrapcp, routing_enums_pb2

    n_cells, n_uavs = problem.n_cells, problem.n_uavs
    n_points = n_cells + 2 * n_uavs
    starts = [*range(n_cells, n_cells + n_uavs)]
    manager = pywrapcp.RoutingIndexManager(
        n_points, n_uavs, starts, [start + n_uavs for start in starts]
    )
    routing = pywrapcp.RoutingModel(manager)
    legs_s = np.array(
        [
            [
                [leg_s(problem, uav, here, there) for there in range(n_points)]
                for here in range(n_points)
            ]
            for uav in range(n_uavs)
        ]
    )
    parts = SPAN_WEIGHT * np.array(problem.speed_mps) / sum(problem.speed_mps)
    times = []
    for uav in range(n_uavs):
        ticks = np.rint(legs_s[uav] * TICKS_PER_S).astype(np.int64)
        times.append(routing.RegisterTransitMatrix(ticks.tolist()))
        weighted = np.rint(ticks * parts[uav]).astype(np.int64)
        cost = routing.RegisterTransitMatrix(weighted.tolist())
        routing.SetArcCostEvaluatorOfVehicle(cost, uav)
    routing.AddDimensionWithVehicleTransits(times, 0, 10**12, True, 'time')
    routing.GetDimensionOrDie('time').SetGlobalSpanCostCoefficient(SPAN_WEIGHT)
    parameters = pywrapcp.DefaultRoutingSearchParameters()
    parameters.first_solution_strategy = (
        routing_enums_pb2.FirstSolutionStrategy.PARALLEL_CHEAPEST_INSERTION
    )
    parameters.local_search_metaheuristic = (
        routing_enums_pb2.LocalSearchMetaheuristic.GUIDED_LOCAL_SEARCH
    )
    parameters.solution_limit = n_solutions
    solution = routing.SolveWithParameters(parameters)
    routes = []
    for uav in range(n_uavs):
        index = routing.Start(uav)
        route = [manager.IndexToNode(index)]
        while not routing.IsEnd(index):
            index = solution.Value(routing.NextVar(index))
            route.append(manager.IndexToNode(index))
        routes.append(route)
    return completion_s(problem, routes)


def ours(problem: PlanProblem, n_rounds: int) -> tuple[float, float]:
    """The shortest plan and its limit [s]; both plans and both limits are found."""
    found = bound._find(problem, 0, n_rounds)
    assert found.shortest is not None
    return found.shortest.completion_s, found.least_completion_s


def main() -> None:
    """Print the table."""
    n_missions, n_solutions = (*map(int, sys.argv[1:]), *(5, 300)[len(sys.argv) - 1 :])
    site = build_site(load(SCENARIO))
    missions = [problem_of(site, seed, 'exact') for seed in range(n_missions)]
    ours(missions[0], 1)  # compiles
    table = Table('search', 'shortest plan s', 'limit s', 'CPU s a mission')
    kernels = os.environ.get('UAV_COLLECT_KERNELS', 'compiled')
    for n_rounds in (bound.N_ROUNDS, 20 * bound.N_ROUNDS):
        start_s = time.process_time()
        found = [ours(problem, n_rounds) for problem in missions]
        used_s = (time.process_time() - start_s) / n_missions
        plan_s, limit_s = np.mean(found, axis=0)
        name = f'both plans and limits, {n_rounds} rounds, {kernels}'
        table.add_row(name, f'{plan_s:.2f}', f'{limit_s:.2f}', f'{used_s:.3f}')
        if kernels != 'compiled':
            break
    if importlib.util.find_spec('ortools'):
        start_s = time.process_time()
        plan_s = np.mean([by_ortools(problem, n_solutions) for problem in missions])
        used_s = (time.process_time() - start_s) / n_missions
        name = f'OR-tools, the shortest plan alone, {n_solutions} solutions'
        table.add_row(name, f'{plan_s:.2f}', '', f'{used_s:.3f}')
    Console().print(f'{SCENARIO}, {n_missions} missions')
    Console().print(table)


if __name__ == '__main__':
    main()
