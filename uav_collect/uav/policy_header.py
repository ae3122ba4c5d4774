"""The header of a frozen policy: what it sees, what it may fly, how it was learned."""

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from itertools import product
from typing import Annotated, TypeVar

from uav_collect.config.rules import number, text, whole
from uav_collect.config.yaml_text import shown
from uav_collect.errors import PolicyMismatchError
from uav_collect.limits import is_code_name, MAX_CELLS_PER_SIDE, MAX_LAYER_SIZE, MAX_SEED
from uav_collect.uav.action_codes import N_ACTIONS, NONE
from uav_collect.uav.briefing import Briefing
from uav_collect.uav.heuristics import Heuristic
from uav_collect.uav.learned_on import LearnedOn, LearnedWithin
from uav_collect.uav.observation import AnyLayout, Layout, observation_size
from uav_collect.uav.operating_domain import MAX_DOMAINS, OperatingDomain

ACTIVATIONS = ('relu', 'tanh')  # of the layers of a network

_ALMOST_ALL = 0.99  # of the missions: from there on efficiency alone decides

_MAX_BONUS = 1e12
_MAX_TEXT = 4096  # characters of a text in a header; one may name many scenarios

_Share = Annotated[float, number(0, 1)]
_Amount = Annotated[float, number(0, 1e12)]
_Shapes = Mapping[str, tuple[int, ...]]
_Tensor = TypeVar('_Tensor')


@dataclass(frozen=True, kw_only=True)
class Validation:
    """What a policy achieved on average in missions that it did not learn from."""

    efficiency_kbit_per_j: _Amount
    completion_s: _Amount
    energy_kj: _Amount
    collected_share: _Share
    complete_share: _Share  # of the missions: all data collected
    safe_share: _Share  # of the missions: every UAV landed with its margin
    missions: Annotated[int, whole(0, MAX_SEED)]
    bandwidth: Annotated[str, text(64)]  # how it was shared

    @property
    def rank(self) -> tuple[float, float]:
        """How good the policy is: of two, the one of greater rank is kept."""
        return policy_rank(self.complete_share, self.safe_share, self.efficiency_kbit_per_j)


def policy_rank(
    complete_share: float, safe_share: float, efficiency_kbit_per_j: float
) -> tuple[float, float]:
    """How good a policy is by its validation: of two, the one of greater rank is kept.

    A policy that leaves data or a UAV behind is no better for having saved energy.
    """
    return min(complete_share, safe_share, _ALMOST_ALL), efficiency_kbit_per_j


@dataclass(frozen=True, kw_only=True)
class PolicyHeader:
    """What a frozen policy sees, what it may fly, and how it was learned."""

    layout: AnyLayout
    observation_size: int
    hidden_size: int  # numbers that a UAV remembers from decision to decision
    cells_per_side_min: int
    cells_per_side_max: int
    n_uavs_min: int
    n_uavs_max: int
    scenario: str  # that it learned in
    fingerprint: str  # of that scenario
    preset: str  # of the training
    algorithm: str  # one of limits.ALGORITHMS, or module:Name
    seed: int  # of the training
    decisions: int  # learned from
    updates: int  # of the weights
    version: str  # for people and for logs: run, update, digest of the weights
    git_revision: str
    validation: Validation
    learned_on: tuple[LearnedOn, ...] = ()  # by scenario; none where the file does not say
    advice_bonus: float = 0.0  # added to the value of what the layout's adviser would do
    learned_within: tuple[LearnedWithin, ...] = ()  # one of drawn scenarios; else none
    network: str = ''  # which it is, see `policy_network`; '': a recurrent one
    code: str = ''  # of users that it learned by, each as module:name@version; '': none
    domains: tuple[OperatingDomain, ...] = ()  # where it decides by itself; none: everywhere

    def misfit(self, briefing: Briefing) -> str | None:
        """Why the policy cannot fly a fleet over an area; None if it can."""
        area, n_uavs = (briefing.n_rows, briefing.n_columns), briefing.n_uavs
        least, most = self.cells_per_side_min, self.cells_per_side_max
        known = _areas_of_paper(self)
        if known and area not in known:
            allowed = ' or '.join(f'{rows} x {columns}' for rows, columns in sorted(known))
            return f'area is {area[0]} x {area[1]} cells: must be {allowed}'
        if not all(least <= side <= most for side in area):
            allowed = f'must have {_span(least, most)} rows and columns'
            return f'area is {area[0]} x {area[1]} cells: {allowed}'
        if not self.n_uavs_min <= n_uavs <= self.n_uavs_max:
            return f'n_uavs is {n_uavs}: must be {_span(self.n_uavs_min, self.n_uavs_max)}'
        return None

    @property
    def n_networks(self) -> int:
        """How many networks the policy has; each has domains of its own."""
        return max((it.network or 1 for it in self.domains), default=1)

    def network_for(self, briefing: Briefing) -> int | None:
        """Which of its networks decides for a fleet over a field, from 1; None: a rule does."""
        if not self.domains:
            return 1
        within = (it.network or 1 for it in self.domains if it.covers(briefing))
        return next(within, None)

    def rule_for(self, briefing: Briefing) -> Heuristic | None:
        """The rule by which the policy flies a fleet over a field; None: a network decides."""
        is_own = self.network_for(briefing) is not None
        return None if is_own else Heuristic(self.layout.adviser)

    def of_network(self, number: int) -> 'PolicyHeader':
        """The header of one of the policy's networks alone, counted from 1, in its domains."""
        own = (it for it in self.domains if (it.network or 1) == number)
        return replace(self, domains=tuple(replace(it, network=None) for it in own))


def check_shapes(header: PolicyHeader, shapes: Mapping[str, tuple[int, ...]]) -> None:
    """Refuse a header that contradicts itself, or tensors that are not of its shapes.

    Raises:
        PolicyMismatchError: one line: what, its value, what it must be.
    """
    _check_texts(header)
    _check_numbers(header)
    for place, own in enumerate(by_network(shapes, header.n_networks), start=1):
        try:
            check_network(header.network, header.observation_size, header.hidden_size, own)
        except PolicyMismatchError as error:
            if header.n_networks == 1:
                raise
            raise PolicyMismatchError(f'network {place}: {error}') from error


def _areas_of_paper(header: PolicyHeader) -> set[tuple[int, int]]:
    """The areas, in rows and columns, that alone a policy can fly; none: not so, or squares."""
    if header.layout.base != Layout.PAPER or not any(it.rows for it in header.learned_on):
        return set()
    return {it.area for it in header.learned_on}


def _check_texts(header: PolicyHeader) -> None:
    for field_ in fields(header):
        value = getattr(header, field_.name)
        if isinstance(value, str) and not (value.isprintable() and len(value) <= _MAX_TEXT):
            allowed = f'{_MAX_TEXT} printable characters at most'
            raise PolicyMismatchError(f'{field_.name} is {shown(value)}: must be {allowed}')


def _check_numbers(header: PolicyHeader) -> None:
    most_uavs = header.layout.max_uavs
    largest = header.cells_per_side_max
    for name, value, low, high in (
        ('hidden_size', header.hidden_size, int(not header.network), MAX_LAYER_SIZE),
        ('cells_per_side_min', header.cells_per_side_min, 1, largest),
        ('cells_per_side_max', largest, header.cells_per_side_min, MAX_CELLS_PER_SIDE),
        ('n_uavs_min', header.n_uavs_min, 1, header.n_uavs_max),
        ('n_uavs_max', header.n_uavs_max, header.n_uavs_min, most_uavs),
    ):
        if not low <= value <= high:
            raise PolicyMismatchError(f'{name} is {value}: must be {_span(low, max(low, high))}')
    most_bonus = _MAX_BONUS if header.layout.adviser != NONE else 0.0
    if not 0.0 <= header.advice_bonus <= most_bonus:
        raise PolicyMismatchError(
            f'advice_bonus is {header.advice_bonus:g}: must be from 0 to {most_bonus:g} for '
            f'{header.layout.label}'
        )
    if header.domains and header.layout.adviser == NONE:
        raise PolicyMismatchError(
            f'domains are given: must be none for {header.layout.label}, which has no adviser'
        )
    for place, domain in enumerate(header.domains, start=1):
        if why := domain.contradiction:
            raise PolicyMismatchError(f'domain {place}: relative_speeds {why}')
        if domain.n_uavs is not None and domain.n_uavs[0] > header.n_uavs_max:
            raise PolicyMismatchError(
                f'domain {place}: n_uavs is {[*domain.n_uavs]}: must begin at'
                f' {header.n_uavs_max} or less, as the policy takes'
            )
    if len(header.domains) > MAX_DOMAINS:
        raise PolicyMismatchError(
            f'domains are {len(header.domains)}: must be at most {MAX_DOMAINS}'
        )
    numbers = {it.network or 1 for it in header.domains} or {1}
    if lacking := {*range(1, header.n_networks + 1)} - numbers:
        raise PolicyMismatchError(
            f'domains of network {min(lacking)} are none: must be one or more for each network'
            f' up to the last, {header.n_networks}'
        )
    squares = {(side, side) for side in (header.cells_per_side_min, header.cells_per_side_max)}
    areas = sorted(_areas_of_paper(header) or squares)
    for (rows, columns), n_uavs in product(areas, (header.n_uavs_min, header.n_uavs_max)):
        size = observation_size(header.layout, rows * columns, n_uavs)
        if size != header.observation_size:
            words = f'{rows} cells per side' if rows == columns else f'{rows} x {columns} cells'
            raise PolicyMismatchError(
                f'observation_size is {header.observation_size}: must be {size} for '
                f'{header.layout.label}, {words} and {n_uavs} UAVs'
            )


def _span(low: int, high: int) -> str:
    return str(low) if low == high else f'{low} to {high}'


def by_network(tensors: Mapping[str, _Tensor], n_networks: int) -> list[dict[str, _Tensor]]:
    """The tensors of each network, by their names within it, or what is known of them.

    Of several networks, each has its number, from 1, and a slash before the names of its tensors.

    Raises:
        PolicyMismatchError: one belongs to none.
    """
    if n_networks == 1:
        return [{**tensors}]
    found: list[dict[str, _Tensor]] = [{} for _ in range(n_networks)]
    numbers = {f'{number}': number for number in range(1, n_networks + 1)}
    for name, tensor in tensors.items():
        number, _, own_name = name.partition('/')
        if number not in numbers or not own_name:
            allowed = f'1/NAME to {n_networks}/NAME'
            raise PolicyMismatchError(f'tensor {shown(name)} is unknown: must be {allowed}')
        found[numbers[number] - 1][own_name] = tensor
    return found


def weight_shapes(observation_size: int, hidden_size: int) -> dict[str, tuple[int, ...]]:
    """The tensors of a recurrent network by name; gates in the order reset, update, new."""
    return {
        'encoder.weight': (hidden_size, observation_size),
        'encoder.bias': (hidden_size,),
        'gru.weight_ih': (3 * hidden_size, hidden_size),
        'gru.weight_hh': (3 * hidden_size, hidden_size),
        'gru.bias_ih': (3 * hidden_size,),
        'gru.bias_hh': (3 * hidden_size,),
        'head.weight': (N_ACTIONS, hidden_size),
        'head.bias': (N_ACTIONS,),
    }


def check_network(text: str, observation_size: int, memory_size: int, shapes: _Shapes) -> None:
    """Refuse tensors that are not of a network's shapes.

    Args:
        text: a header's `network`.
        memory_size: numbers that a UAV remembers from decision to decision.
        shapes: by name.

    Raises:
        PolicyMismatchError: one line: what, its value, what it must be.
    """
    if is_code_name(text):  # its class knows them
        return
    wanted = (
        _layer_shapes(text, observation_size, memory_size, shapes)
        if text
        else weight_shapes(observation_size, memory_size)
    )
    if unlike := sorted(wanted.keys() ^ shapes.keys()):
        what = 'is missing' if unlike[0] in wanted else 'is unknown'
        raise PolicyMismatchError(f'tensor {shown(unlike[0])} {what}: must be {", ".join(wanted)}')
    for name, shape in wanted.items():
        if shapes[name] != shape:
            raise PolicyMismatchError(
                f'{name} has shape {shown([*shapes[name]])}: must be {list(shape)}'
            )


def _layer_shapes(
    text: str, observation_size: int, memory_size: int, shapes: _Shapes
) -> dict[str, tuple[int, ...]]:
    """The shapes that layers must have one behind the other; their widths are the tensors' own."""
    wanted: dict[str, tuple[int, ...]] = {}
    names = [name for name in text.split() if name not in ACTIVATIONS]
    width, n_cells = observation_size, 0
    for name in names:
        if f'{name}.weight_ih' in shapes:
            gates, n_cells = 3 * memory_size, n_cells + 1
            wanted |= {
                f'{name}.weight_ih': (gates, width),
                f'{name}.weight_hh': (gates, memory_size),
                f'{name}.bias_ih': (gates,),
                f'{name}.bias_hh': (gates,),
            }
            width = memory_size
            continue
        shape = shapes.get(f'{name}.weight', ())
        if len(shape) == 1:
            wanted |= {f'{name}.weight': (width,), f'{name}.bias': (width,)}
            continue
        n_out = N_ACTIONS if name == names[-1] else (*shape, 0)[0]
        if not 1 <= n_out <= MAX_LAYER_SIZE:
            raise PolicyMismatchError(
                f'layer {shown(name)} has no weights of 1 to {MAX_LAYER_SIZE} rows'
            )
        wanted |= {f'{name}.weight': (n_out, width), f'{name}.bias': (n_out,)}
        width = n_out
    if width != N_ACTIONS or n_cells != int(memory_size > 0):
        raise PolicyMismatchError(
            f'network is {shown(text)}: must end in {N_ACTIONS} values, and have'
            f' {"one GRU cell" if memory_size else "no GRU cell"}'
        )
    return wanted
