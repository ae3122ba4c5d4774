"""The bandwidth problem for general solvers: slow, but easy to change and to believe.

`allocate_cvxpy` states it in cvxpy, for users who want to add a constraint or another objective;
`shortest_hover_s` states the same as cones to Clarabel, as accurately as that can. Both use
the scaled numbers of `bandwidth`, with 1 / u in units of the equal split's hover time. With
C = e + x, convex programming's rules accept f as

    x log(1 + s / C) = -rel_entr(C, C + s) - e logistic(log s - log C).
"""

from dataclasses import dataclass
from functools import lru_cache
import math
import warnings

import clarabel
import cvxpy as cp
import numpy as np
from scipy import sparse
from uav_collect.errors import AllocationError
from uav_collect.kernels.arrays import Floats
from uav_collect.physics.allocation import allocate_equal, Allocation
from uav_collect.physics.bandwidth import certified_gap, hover_time_s

# A row of a cone program: factors by variable, and a constant.
_Row = tuple[dict[int, float], float]

# So accurate an answer is a matter of luck: where one way ends short of it, another arrives.
_TIGHT_SETTINGS: tuple[dict[str, object], ...] = tuple(
    {'tol_gap_abs': accuracy, 'tol_gap_rel': accuracy, 'tol_feas': accuracy, **variant}
    for accuracy in (1e-11, 1e-10)
    for variant in (
        {},
        {'equilibrate_enable': False},
        {'max_step_fraction': 0.9},
        {'max_step_fraction': 0.8},
        {'max_step_fraction': 0.9, 'equilibrate_enable': False},
        {'static_regularization_constant': 1e-12},
    )
)

_SMALLEST_SHARE = 1e-12  # a solver may end a hair below 0, where there is no rate


@dataclass(frozen=True, kw_only=True)
class Program:
    """The scaled problem of one hover with n sensors in cvxpy: numbers go into its parameters."""

    problem: cp.Problem
    x: cp.Variable  # (n,) shares of the bandwidth
    s: cp.Parameter  # (n,)
    log_s: cp.Parameter  # (n,)
    e: cp.Parameter  # (n,)
    c: cp.Parameter  # (n,)


def build_program(n: int, with_error: bool) -> Program:
    """State the problem for n sensors; `with_error` if any channel is known with an error."""
    x, u = cp.Variable(n, nonneg=True), cp.Variable()
    s, e, c = (cp.Parameter(n, nonneg=True) for _ in range(3))
    log_s = cp.Parameter(n)
    if with_error:
        level = e + x
        spread = cp.Variable(n)  # log(1 + s / C), apart: a product may hold one parameter only
        f = -cp.rel_entr(level, level + s) - cp.multiply(e, spread)
        constraints = [cp.logistic(log_s - cp.log(level)) <= spread]
    else:
        f = -cp.rel_entr(x, x + s)
        constraints = []
    constraints += [f >= c * u, cp.sum(x) <= 1]
    problem = cp.Problem(cp.Maximize(u), constraints)
    return Program(problem=problem, x=x, s=s, log_s=log_s, e=e, c=c)


def allocate_cvxpy(
    signal_w: Floats,
    error_w: Floats,
    demand_bit: Floats,
    bandwidth_hz: float,
    noise_w_per_hz: float,
) -> Allocation:
    """Solve one program per hover by Clarabel, slowly; otherwise as `allocation.allocate_exact`.

    Raises:
        AllocationError: also when the solver gives up.
    """
    equal = allocate_equal(signal_w, error_w, demand_bit, bandwidth_hz, noise_w_per_hz)
    share_hz, hover_s, gap = equal.share_hz.copy(), equal.hover_s.copy(), equal.gap.copy()
    for m in range(len(signal_w)):
        if not 0.0 < equal.hover_s[m] < math.inf:
            continue
        row = (signal_w[m], error_w[m], demand_bit[m])
        active = demand_bit[m] > 0.0
        s, e, c = scaled(*row, bandwidth_hz, noise_w_per_hz, float(equal.hover_s[m]))
        try:
            program = _kept_program(len(s), bool((e > 0.0).any()))
            x = solve_program(program, s, e, c)
        except cp.SolverError as error:
            raise AllocationError(f'hover {m}: the solver gave up: {error}') from error
        share_hz[m, active] = x * bandwidth_hz
        n = len(active)
        hover_s[m] = hover_time_s(*row, share_hz[m], n, noise_w_per_hz)
        gap[m] = certified_gap(
            *row, share_hz[m], n, bandwidth_hz, noise_w_per_hz, float(hover_s[m])
        )
    return Allocation(share_hz=share_hz, hover_s=hover_s, gap=gap)


def scaled(
    signal_w: Floats,
    error_w: Floats,
    demand_bit: Floats,
    bandwidth_hz: float,
    noise_w_per_hz: float,
    time_unit_s: float,
) -> tuple[Floats, Floats, Floats]:
    """Numbers s, e and c [time units] of the sensors with demand."""
    active = demand_bit > 0.0
    noise_w = noise_w_per_hz * bandwidth_hz
    c = demand_bit[active] * math.log(2.0) / bandwidth_hz / time_unit_s
    return signal_w[active] / noise_w, error_w[active] / noise_w, c


# Once compiled, a program serves all hovers with as many sensors: only its numbers change.
_kept_program = lru_cache(maxsize=64)(build_program)


def solve_program(program: Program, s: Floats, e: Floats, c: Floats) -> Floats:
    """Parts of the bandwidth, shape (n,), for the scaled numbers of a hover's n sensors.

    Raises:
        cvxpy.SolverError: Clarabel finds none under any of its settings.
    """
    program.s.value, program.e.value, program.c.value = s, e, c
    program.log_s.value = np.log(s)
    with warnings.catch_warnings():
        # The certified gap says how inaccurate a solution is.
        warnings.filterwarnings('ignore', message='Solution may be inaccurate')
        for settings in ({}, *_TIGHT_SETTINGS):
            try:
                # A warm start would make the shares depend on what was solved before.
                program.problem.solve(solver=cp.CLARABEL, warm_start=False, **settings)
            except cp.SolverError:
                continue
            if program.x.value is not None:
                x = np.maximum(program.x.value, _SMALLEST_SHARE)
                share: Floats = x / x.sum()
                return share
    raise cp.SolverError('Clarabel finds no shares under any of its settings')


def shortest_hover_s(
    signal_w: Floats,
    error_w: Floats,
    demand_bit: Floats,
    bandwidth_hz: float,
    noise_w_per_hz: float,
) -> float:
    """Hover time [s] of one hover's best shares, by Clarabel's account, to some nine digits.

    Arguments as rows, shape (S,), for `allocation.allocate_exact`.

    Raises:
        AllocationError: Clarabel cannot tell: the numbers span too many decades for it.
    """
    equal = allocate_equal(
        signal_w[None], error_w[None], demand_bit[None], bandwidth_hz, noise_w_per_hz
    )
    unit_s = float(equal.hover_s[0])
    if not 0.0 < unit_s < math.inf:
        return unit_s
    s, e, c = scaled(signal_w, error_w, demand_bit, bandwidth_hz, noise_w_per_hz, unit_s)
    program = ConeProgram(s, e, c)
    for settings in _TIGHT_SETTINGS:
        solution = program.solve(**settings)
        if solution.status == clarabel.SolverStatus.Solved:
            return unit_s / float(solution.x[program.u])
    raise AllocationError(f'Clarabel ended with {solution.status} under all its settings')


class ConeProgram:
    """The scaled problem of one hover as Clarabel reads it: rows constant - A z in cones.

    z holds x_1 .. x_n, u, and five more for each sensor with a channel error. An exponential cone
    is {(a, b, d): b exp(a / b) <= d, b > 0}.
    """

    def __init__(self, s: Floats, e: Floats, c: Floats) -> None:
        self.u = len(s)
        self._n_variables = len(s) + 1
        self._entries: list[tuple[int, int, float]] = []
        self._constants: list[float] = []
        self._cones: list[object] = []
        self._add_bound(dict.fromkeys(range(len(s)), -1.0), 1.0)
        for i, (s_i, e_i, c_i) in enumerate(zip(s.tolist(), e.tolist(), c.tolist(), strict=True)):
            if e_i == 0.0:
                self._add_cone(({self.u: c_i}, 0.0), ({i: 1.0}, 0.0), ({i: 1.0}, s_i))
            else:
                self._add_erring_sensor(i, s_i, e_i, c_i)
        columns = [column for _, column, _ in self._entries]
        rows = [row for row, _, _ in self._entries]
        factors = [factor for _, _, factor in self._entries]
        shape = (len(self._constants), self._n_variables)
        self._matrix = sparse.csc_matrix((factors, (rows, columns)), shape=shape)
        self._quadratic = sparse.csc_matrix((self._n_variables, self._n_variables))
        self._cost = np.zeros(self._n_variables)
        self._cost[self.u] = -1.0

    def solve(self, **settings: object) -> clarabel.DefaultSolution:
        """Clarabel's answer, found under its default settings but for those given."""
        options = clarabel.DefaultSettings()
        options.verbose = False
        for name, value in settings.items():
            setattr(options, name, value)
        constants = np.array(self._constants)
        return clarabel.DefaultSolver(
            self._quadratic, self._cost, self._matrix, constants, self._cones, options
        ).solve()

    def _add_erring_sensor(self, i: int, s: float, e: float, c: float) -> None:
        entropy, spread, log_level, part, other_part = range(
            self._n_variables, self._n_variables + 5
        )
        self._n_variables += 5
        one: _Row = ({}, 1.0)
        self._add_cone(({entropy: 1.0}, 0.0), ({i: 1.0}, e), ({i: 1.0}, e + s))
        # spread >= log(1 + s / C), as exp(-spread) + exp(log s - log C - spread) <= 1
        self._add_cone(({log_level: 1.0}, 0.0), one, ({i: 1.0}, e))
        self._add_cone(({spread: -1.0}, 0.0), one, ({part: 1.0}, 0.0))
        exponent = {log_level: -1.0, spread: -1.0}
        self._add_cone((exponent, math.log(s)), one, ({other_part: 1.0}, 0.0))
        self._add_bound({part: -1.0, other_part: -1.0}, 1.0)
        self._add_bound({entropy: 1.0, spread: -e, self.u: -c}, 0.0)

    def _add_bound(self, terms: dict[int, float], constant: float) -> None:
        # The constant plus the terms may not be negative.
        self._add_row((terms, constant))
        self._cones.append(clarabel.NonnegativeConeT(1))

    def _add_cone(self, a: _Row, b: _Row, d: _Row) -> None:
        for row in (a, b, d):
            self._add_row(row)
        self._cones.append(clarabel.ExponentialConeT())

    def _add_row(self, row: _Row) -> None:
        terms, constant = row
        index = len(self._constants)
        self._entries += [(index, column, -factor) for column, factor in terms.items()]
        self._constants.append(constant)
