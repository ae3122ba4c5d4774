"""What a fleet could do in a mission if it knew all demand beforehand: plans, and proven bounds.

Two plans of the same mission, the shortest and the one of least energy that a search finds, both
of which the world can fly as they are; and for each a number below which no flight gets that
collects everything. These numbers are bounds; the plans are none, though rarely beaten.

- What stands beside the shortest plan is its time, beside the one of least energy its energy and
  energy efficiency.
- Missions that leave data behind know no bound: they may be shorter, and even more efficient.

In a plan a UAV flies home from the last cell that it serves. A policy's UAVs fly on until each
knows every cell to be complete; nothing in the world's rules makes up for that. So a policy hardly
gets as far as a plan. A plan is the best one found, and now and then beaten: by one that was not
found, or by channels that a later visit draws better. The bounds are not: they hold for any moves,
any number of visits and any draws.
"""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
import hashlib
from itertools import pairwise
import json
import math
from pathlib import Path
from typing import Any

from uav_collect import files
from uav_collect.kernels.arrays import row_of
from uav_collect.kernels.compile import cache_folder
from uav_collect.planning.problem import PlanProblem, problem_of
from uav_collect.planning.relaxation import climb, least_completion_s, least_energy_j
from uav_collect.planning.search import Aim, best_routes, Routes, search
from uav_collect.scenario.area import cell_of, open_cells
from uav_collect.scenario.load import fingerprint
from uav_collect.scenario.model import Scenario
from uav_collect.scenario.site import Site
from uav_collect.uav.action_codes import BACKWARD, FORWARD, HOVER, LEFT, RIGHT
from uav_collect.uav.open_ways import OpenCells

KERNELS = (search, climb)  # that find plans, and what no plan beats
N_ROUNDS = 2000  # of the search for each plan: some 0.3 s where kernels are interpreted
_MAX_BYTES = 2**22  # of a bound that is kept
_BALANCE = 0.1  # weight of all UAVs' times beside the latest one's, where the search is steered
_TIE_S_PER_J = 1e-10  # of plans that take the same time the one of less energy is the best


@dataclass(frozen=True, kw_only=True)
class Plan:
    """A way to collect all data of a mission; rows are by UAV."""

    cells: tuple[tuple[int, ...], ...]  # where the UAV hovers, in order; then it flies home
    landed_s: tuple[float, ...]
    energy_j: tuple[float, ...]  # way home included

    @property
    def completion_s(self) -> float:
        """When the last UAV is home [s]."""
        return max(self.landed_s)

    @property
    def total_energy_j(self) -> float:
        """Energy of all UAVs [J]."""
        return math.fsum(self.energy_j)

    def __str__(self) -> str:
        lines = [f'{self.completion_s:.1f} s, {self.total_energy_j / 1e3:.2f} kJ']
        for uav, cells in enumerate(self.cells):
            hovers = ', '.join(map(str, cells)) or 'none'
            used = f'{self.landed_s[uav]:.1f} s, {self.energy_j[uav] / 1e3:.2f} kJ'
            lines.append(f'  UAV {uav + 1}: {used}, hovers over cells: {hovers}')
        return '\n'.join(lines)


@dataclass(frozen=True, kw_only=True)
class Bound:
    """What is possible in a mission: the best plans that were found, and what none can beat.

    A plan is None where none within the budgets was found.
    """

    mission_seed: int
    n_data_cells: int
    total_bit: float
    shortest: Plan | None
    thriftiest: Plan | None  # the one of least energy
    least_completion_s: float  # no fleet that collects everything is home before
    least_energy_j: float  # or has used less

    def efficiency_kbit_per_j(self, plan: Plan) -> float:
        """Energy efficiency of a plan [kbit/J]; 0 where it uses no energy."""
        energy_j = plan.total_energy_j
        return self.total_bit / energy_j / 1e3 if energy_j > 0.0 else 0.0


def bound_of(
    site: Site,
    mission_seed: int,
    allocator: str = 'exact',
    n_rounds: int = N_ROUNDS,
) -> Bound:
    """Plans and bounds of a mission, from the disk where they were found before.

    The same arguments give the same, however kernels run.

    Args:
        allocator: how bandwidth is shared, one of `limits.ALLOCATOR_NAMES`; cvxpy counts as exact.
        n_rounds: of the search for each plan; with more of them better plans may be found.
    """
    share = 'equal' if allocator == 'equal' else 'exact'
    kind = f'{fingerprint(site.scenario)}_{share}_{n_rounds}'
    file = cache_folder() / 'bounds' / kind / f'{mission_seed}.json'
    bound = _read(file)
    if bound is None:
        bound = _find(problem_of(site, mission_seed, share), mission_seed, n_rounds)
        _write(file, bound)
    return bound


def flight_actions(scenario: Scenario, plan: Plan) -> tuple[list[int], ...]:
    """The actions that fly a plan, by UAV; after the last one the UAV flies home."""
    area = scenario.area
    cells_of_area = OpenCells(area.n_rows, area.n_columns, open_cells(area).tolist())
    starts = [cell_of(area, uav.start_m) for uav in scenario.uavs]
    return tuple(
        _flight(cells_of_area, start, cells)[1]
        for start, cells in zip(starts, plan.cells, strict=True)
    )


def _flight(area: OpenCells, start: int, cells: Sequence[int]) -> tuple[list[int], list[int]]:
    """The order in which a route serves its cells, and the actions that fly it.

    A cell on the way to another one is served when the UAV first comes there: that is no detour,
    and the channels are those of the first visit. The straight way back comes after a hover only,
    where it is legal.
    """
    here, waiting = start, dict.fromkeys(cells)
    order: list[int] = []
    flown: list[int] = []
    while waiting:
        if here in waiting:
            del waiting[here]
            order.append(here)
            flown.append(HOVER)
            continue
        there = area.step(here, next(iter(waiting)))
        if there // area.n_columns != here // area.n_columns:
            flown.append(FORWARD if there > here else BACKWARD)
        else:
            flown.append(RIGHT if there > here else LEFT)
        here = there
    return order, flown


def _find(problem: PlanProblem, mission_seed: int, n_rounds: int) -> Bound:
    power_w = problem.flight_power_w, problem.hover_power_w
    aim = Aim(1.0, *(row_of([_TIE_S_PER_J * each_w for each_w in row]) for row in power_w))
    total_mps = sum(problem.speed_mps)
    balance = row_of([_BALANCE * speed_mps / total_mps for speed_mps in problem.speed_mps])
    routes = best_routes(problem, aim, Aim(1.0, balance, balance), n_rounds)
    shortest = _plan(problem, routes)
    energy = Aim(0.0, *power_w)
    thriftiest = _plan(problem, best_routes(problem, energy, energy, n_rounds))
    lowest_s = least_completion_s(problem, sum(routes.length_m), shortest.completion_s)
    lowest_j = least_energy_j(problem, thriftiest.total_energy_j)
    return Bound(
        mission_seed=mission_seed,
        n_data_cells=problem.n_cells,
        total_bit=problem.total_bit,
        shortest=shortest if _is_affordable(problem, shortest) else None,
        thriftiest=thriftiest if _is_affordable(problem, thriftiest) else None,
        least_completion_s=float(lowest_s),
        least_energy_j=float(lowest_j),
    )


def _plan(problem: PlanProblem, routes: Routes) -> Plan:
    """The plan of routes, as it is flown."""
    cells, landed_s, energy_j = [], [], []
    for uav in range(problem.n_uavs):
        points = _flown_points(problem, routes, uav)
        hovers_s = [problem.hover_s[uav * problem.n_cells + point] for point in points]
        hover_s = math.fsum(hovers_s)
        flight_s = _length_m(problem, uav, points) / problem.speed_mps[uav]
        flight_j = problem.flight_power_w[uav] * flight_s
        cells.append(tuple(int(problem.cell[point]) for point in points))
        landed_s.append(float(flight_s + hover_s))
        energy_j.append(float(flight_j + problem.hover_power_w[uav] * hover_s))
    return Plan(cells=tuple(cells), landed_s=tuple(landed_s), energy_j=tuple(energy_j))


def _flown_points(problem: PlanProblem, routes: Routes, uav: int) -> list[int]:
    """The data cells of a UAV's route in the order in which it serves them."""
    point_of: dict[int, int] = {}  # in the order of the route
    point = routes.after[problem.n_cells + uav]
    while point < problem.n_cells:
        point_of[int(problem.cell[point])] = point
        point = routes.after[point]
    n_rows = len(problem.is_open) // problem.n_columns
    area = OpenCells(n_rows, problem.n_columns, problem.is_open)
    order, _ = _flight(area, int(problem.start_cell[uav]), [*point_of])
    return [point_of[cell] for cell in order]


def _length_m(problem: PlanProblem, uav: int, cells: Sequence[int]) -> float:
    n_cells, n_uavs = problem.n_cells, problem.n_uavs
    points = [n_cells + uav, *cells, n_cells + n_uavs + uav]
    n_points = n_cells + 2 * n_uavs
    return math.fsum(problem.way_m[here * n_points + there] for here, there in pairwise(points))


def _is_affordable(problem: PlanProblem, plan: Plan) -> bool:
    # The search adds and subtracts in its own order; the world allows twice this rounding.
    pairs = zip(plan.energy_j, problem.allowance_j, strict=True)
    return all(energy_j <= allowance_j * (1.0 + 5e-10) for energy_j, allowance_j in pairs)


def _read(file: Path) -> Bound | None:
    """The bound that a file keeps; None where there is no file, or a broken one."""
    try:
        digest, content = files.read_bounded(file, _MAX_BYTES).split(b'\n', 1)
        if digest.decode() != hashlib.sha256(content).hexdigest():
            return None
        values: dict[str, Any] = json.loads(content)
        plans = {name: _plan_of(values[name]) for name in ('shortest', 'thriftiest')}
        return Bound(**(values | plans))
    except (OSError, ValueError, TypeError, KeyError):
        return None


def _plan_of(values: dict[str, Any] | None) -> Plan | None:
    if values is None:
        return None
    return Plan(
        cells=tuple(tuple(cells) for cells in values['cells']),
        landed_s=tuple(values['landed_s']),
        energy_j=tuple(values['energy_j']),
    )


def _write(file: Path, bound: Bound) -> None:
    """Keep a bound, whole or not at all; where the disk does not take it, it is found again."""
    with suppress(OSError):
        file.parent.mkdir(parents=True, exist_ok=True)
        content = json.dumps(asdict(bound)).encode()
        digest = hashlib.sha256(content).hexdigest().encode()
        files.write_atomically(file, digest + b'\n' + content)
