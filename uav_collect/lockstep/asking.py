"""When a tool asks a world, and what it says when no answer counts."""

from dataclasses import dataclass
import math

PATIENCE_S = 10.0  # until a world is found that answers, unless users say else
_AGAIN_S = 2.0  # from a request that nobody has answered to the next one


@dataclass
class Asking:
    """One request: each world is asked once, unless asking twice does no more than once.

    What is lost, the request or its answer, cannot be told apart; a step that is asked for again
    may be the second one. Times are monotonic [s].
    """

    is_repeatable: bool
    begun_s: float
    place: str  # where a world is looked for, for people
    patience_s: float = PATIENCE_S
    refusal: str = ''  # why the latest answer does not count
    _world: str = ''  # instance of the one that was asked last
    _asked_s: float = -math.inf

    def asks(self, world: str, now_s: float) -> bool:
        """Whether to ask a world now, by its instance, which is empty if there is none."""
        is_again = world == self._world
        is_early = not self.is_repeatable or now_s - self._asked_s < _AGAIN_S
        if not world or (is_again and is_early):
            return False
        self._world, self._asked_s = world, now_s
        return True

    def complaint(self, now_s: float) -> str | None:
        """What is wrong when patience has come to its end; None before that."""
        if now_s - self.begun_s <= self.patience_s:
            return None
        if self.refusal:
            return f'no answer counts, the latest one is refused: {self.refusal}'
        within = f'within {self.patience_s:g} s'
        if self._world:
            return f'a world was asked and has not answered {within}; it may have done it'
        why = 'is one started there, with the same key (UAV_COLLECT_KEY_FILE)?'
        return f'no world was found {within} in {self.place}: {why}'
