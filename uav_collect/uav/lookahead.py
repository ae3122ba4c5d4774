"""A policy that looks ahead: it improves a rule by trying each action in futures that it imagines.

A UAV imagines each legal action in the same futures, the rest of each flown by the rule, and does
what leads to the best energy efficiency on average; another action than the rule's only where the
gain is larger than its standard error. It knows no more than its rule does.

Source: rollout algorithms, Bertsekas, "Dynamic Programming and Optimal Control", vol. I, ch. 6.
"""

from dataclasses import dataclass, field
import math

from uav_collect.config.yaml_text import shown
from uav_collect.errors import PolicyMismatchError
from uav_collect.kernels.arrays import new_row, Row
from uav_collect.kernels.compile import kernel, kernels_are_compiled, long_kernel
from uav_collect.limits import GUARD_AFTER, LEAST_FUTURES, LOOKAHEAD, MOST_FUTURES
from uav_collect.scenario.model import Scenario
from uav_collect.uav.action_codes import HOME, N_ACTIONS
from uav_collect.uav.belief import Belief
from uav_collect.uav.briefing import Briefing
from uav_collect.uav.futures import (
    begin_future,
    Contacts,
    draw_future,
    fly_future,
    Future,
    new_contacts,
    new_future,
    note_contacts,
)
from uav_collect.uav.heuristics import choose, Heuristic, MEMORY_SIZE, shares_for
from uav_collect.uav.moves import Moves, new_moves
from uav_collect.uav.sharing import Shares
from uav_collect.uav.view import LocalView

N_FUTURES = 32  # unless users say else
_NOTED_S = 1.0  # a decision that takes longer is worth a word
# What a decision takes for each future and cell of the area, by compiled and by interpreted
# kernels: as many decisions follow as there are cells. And more for each cell that a rule then
# looks at [us].
_COMPILED_US, _INTERPRETED_US = (0.7, 0.006), (90.0, 0.3)
_DIGITS = 5  # a number of futures has fewer


@dataclass(frozen=True)
class _Board:
    """What the UAVs of a fleet share: the rule's ways, and room to imagine in."""

    briefing: Briefing
    shares: Shares
    moves: Moves
    future: Future


@dataclass
class _Boards:
    """The board of the fleet that flies; copies of a policy share it."""

    latest: _Board | None = None

    def of(self, rule: int, briefing: Briefing) -> _Board:
        """The board of a briefing, made anew where it is another one than before."""
        if self.latest is None or self.latest.briefing is not briefing:
            shares, moves = shares_for(rule, briefing), new_moves(briefing)
            self.latest = _Board(briefing, shares, moves, new_future(briefing))
        return self.latest


@dataclass
class LookaheadPolicy:
    """A rule that looks ahead, behind the protocol `policy.Policy`.

    After GUARD_AFTER decisions that taught its UAV of no complete cell it does what its rule does,
    until it knows more: so it circles no more than that.
    """

    rule: Heuristic
    n_futures: int = N_FUTURES
    boards: _Boards = field(default_factory=_Boards, repr=False, compare=False)
    _board: _Board | None = field(default=None, init=False)
    _contacts: Contacts | None = field(default=None, init=False)
    _uav: int = field(default=0, init=False)
    _memory: Row[int] = field(default_factory=lambda: new_row(MEMORY_SIZE, 0), init=False)
    _n_known: int = field(default=0, init=False)  # complete cells at the latest decision
    _n_idle: int = field(default=0, init=False)  # decisions before it since there were fewer

    @property
    def name(self) -> str:
        """The name that users type, without the usual number of futures."""
        number = '' if self.n_futures == N_FUTURES else f':{self.n_futures}'
        return f'{LOOKAHEAD}:{self.rule.label}{number}'

    @property
    def version(self) -> str:
        """As its rule's: it does not change while it flies."""
        return 'rule'

    def begin(self, briefing: Briefing, uav: int) -> None:
        """Forget the last mission and get ready to fly a UAV, by index."""
        self._board, self._uav = self.boards.of(self.rule, briefing), uav
        self._contacts = new_contacts(briefing)
        self._memory = new_row(MEMORY_SIZE, 0)
        self._n_known = self._n_idle = 0

    def choose(self, belief: Belief, view: LocalView, legal: Row[int]) -> int:
        """One of the legal actions, or HOME where the rule ends the mission."""
        board, contacts = self._board, self._contacts
        if board is None or contacts is None:
            raise RuntimeError('a policy must begin a mission before it chooses')
        self._n_idle += 1
        if belief.n_complete[0] > self._n_known:
            self._n_known, self._n_idle = int(belief.n_complete[0]), 0
        is_free = sum(legal) > 1 and self._n_idle < GUARD_AFTER
        return int(
            look_ahead(
                int(self.rule),
                self.n_futures if is_free else 0,
                board.briefing,
                board.shares,
                board.moves,
                self._uav,
                belief,
                view,
                legal,
                self._memory,
                contacts,
                board.future,
            )
        )


@long_kernel
def look_ahead(
    rule: int,
    n_futures: int,
    briefing: Briefing,
    shares: Shares,
    moves: Moves,
    uav: int,
    belief: Belief,
    view: LocalView,
    legal: Row[int],
    memory: Row[int],
    contacts: Contacts,
    future: Future,
) -> int:
    """The action that is best on average of so many futures; without any, the rule's.

    Args:
        shares: what `heuristics.shares_for` gives.
        moves: scratch.
        legal: 1 for each legal action, shape (N_ACTIONS,), at least one.
        memory: of the rule, read and written, shape (MEMORY_SIZE,).
        contacts: read and written.
        future: scratch.
    """
    note_contacts(briefing, contacts, belief)
    usual = choose(rule, briefing, shares, moves, uav, belief, view, legal, memory)
    for action in range(N_ACTIONS + 1):
        future.gain[action] = 0.0
        future.gain_squared[action] = 0.0
    for number in range(n_futures):
        draw_future(briefing, belief, future, uav, view.time_s, number)
        for action in range(N_ACTIONS + 1):
            if action == usual or (action != HOME and legal[action] == 1):
                begin_future(rule, briefing, shares, uav, belief, view, memory, contacts, future)
                future.value[action] = fly_future(
                    rule, briefing, shares, moves, uav, action, future
                )
        for action in range(N_ACTIONS):
            if legal[action] == 1:
                gain = future.value[action] - future.value[usual]
                future.gain[action] += gain
                future.gain_squared[action] += gain * gain
    return _best(n_futures, legal, usual, future)


@kernel
def _best(n_futures: int, legal: Row[int], usual: int, future: Future) -> int:
    """The action of the greatest mean gain among those whose gain is larger than its error."""
    best, most = usual, 0.0
    for action in range(N_ACTIONS):
        if n_futures == 0 or legal[action] == 0 or action == usual:
            continue
        mean = future.gain[action] / n_futures
        variance = max(future.gain_squared[action] / n_futures - mean * mean, 0.0)
        error = math.sqrt(variance / (n_futures - 1))
        if mean > error and mean > most:
            best, most = action, mean
    return best


def lookahead_named(name: str) -> LookaheadPolicy:
    """The policy of a name that `limits.is_lookahead_name` takes.

    Raises:
        PolicyMismatchError: it names no rule, or no number of futures.
    """
    base, colon, number = name.removeprefix(f'{LOOKAHEAD}:').partition(':')
    rules = {rule.label: rule for rule in Heuristic}
    if base not in rules:
        raise PolicyMismatchError(
            f'policy {shown(name)}: it looks ahead with {shown(base)}: must be one of'
            f' {", ".join(rules)}'
        )
    if not colon:
        return LookaheadPolicy(rules[base])
    is_number = number.isdecimal() and number.isascii() and len(number) < _DIGITS
    if not is_number or not LEAST_FUTURES <= int(number) <= MOST_FUTURES:
        raise PolicyMismatchError(
            f'policy {shown(name)}: {shown(number)} futures: must be a whole number from'
            f' {LEAST_FUTURES} to {MOST_FUTURES}'
        )
    return LookaheadPolicy(rules[base], int(number))


def decision_us(policy: LookaheadPolicy, n_cells: int, *, is_compiled: bool) -> float:
    """About what a decision takes on a usual core [us].

    Args:
        n_cells: of the area.
        is_compiled: whether kernels are.
    """
    fixed_us, each_us = _COMPILED_US if is_compiled else _INTERPRETED_US
    return policy.n_futures * n_cells * (fixed_us + each_us * n_cells)


def slowness(policy: LookaheadPolicy, scenario: Scenario) -> str | None:
    """In one line, that decisions take long, as kernels are interpreted; None if they do not."""
    decision_s = decision_us(policy, scenario.n_cells, is_compiled=False) * 1e-6
    if kernels_are_compiled() or decision_s < _NOTED_S:
        return None
    return (
        f'policy {policy.name} takes about {decision_s:.1f} s for a decision, as kernels are'
        f' interpreted here; {LOOKAHEAD}:{policy.rule.label}:{LEAST_FUTURES} takes less'
    )
