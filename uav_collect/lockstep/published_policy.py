"""Policies that trainers publish: which of them count, and how a UAV flies each mission by one."""

from collections import deque
from dataclasses import dataclass
import hashlib
import math
from typing import Any

from uav_collect.kernels.arrays import Row
from uav_collect.uav.belief import Belief
from uav_collect.uav.briefing import Briefing
from uav_collect.uav.policy import ExploringPolicy, flown_version, LearnedPolicy, TOPIC
from uav_collect.uav.policy_file import policy_from_bytes
from uav_collect.uav.policy_network import FrozenPolicy, PolicyMismatchError
from uav_collect.uav.view import LocalView

_KEPT = 4  # policies; a mission may begin with one that is no longer the latest

Key = tuple[str, int]  # trainer_instance and sequence of a Policy message


@dataclass(frozen=True, kw_only=True)
class Published:
    """A Policy message that was checked."""

    message: Any
    frozen: FrozenPolicy

    @property
    def key(self) -> Key:
        """Which message it is."""
        return self.message.trainer_instance, self.message.sequence

    @property
    def version(self) -> str:
        """What commands, logs and transitions say."""
        return flown_version(self.frozen.header.version, self.message.epsilon)

    def follows(self, other: 'Published') -> bool:
        """Whether it was published after another one."""
        (trainer, sequence), (other_trainer, other_sequence) = self.key, other.key
        if trainer == other_trainer:
            return bool(sequence > other_sequence)
        return _stamp(self.message) > _stamp(other.message)

    def pilot(self, mission_seed: int) -> ExploringPolicy:
        """What flies a UAV in a mission."""
        return ExploringPolicy(
            LearnedPolicy(self.version, self.frozen),
            self.message.epsilon,
            self.message.hover_share,
            mission_seed,
        )


def checked(msg: Any, briefing: Briefing) -> Published:
    """The policy in a message.

    Raises:
        PolicyMismatchError: it is not whole, or cannot fly this fleet over this area.
    """
    content = bytes(msg.content)
    digest = hashlib.sha256(content).hexdigest()
    if digest != msg.sha256:
        raise PolicyMismatchError(f'its SHA-256 is {digest[:8]}..., not {msg.sha256[:8]}...')
    frozen = policy_from_bytes(content)
    if frozen.header.version != msg.version:
        raise PolicyMismatchError(f'its file is of version {frozen.header.version!r}')
    misfit = frozen.misfit(briefing)
    if misfit is not None:
        raise PolicyMismatchError(misfit)
    if not 0.0 <= msg.epsilon <= 1.0:
        raise PolicyMismatchError(f'epsilon is {msg.epsilon}: must be 0 to 1')
    if not (math.isfinite(msg.hover_share) and msg.hover_share <= 1.0):
        raise PolicyMismatchError(f'hover_share is {msg.hover_share}: must be at most 1')
    return Published(message=msg, frozen=frozen)


class Shelf:
    """The policies that one world, or one of its agents, has heard of last."""

    def __init__(self, briefing: Briefing) -> None:
        """Keep policies for a fleet and its area."""
        self._briefing = briefing
        self._heard: deque[Any] = deque(maxlen=_KEPT)  # messages, those refused included
        self._kept: dict[Key, Published] = {}  # in the order they came
        self._is_abandoned = False
        self.latest: Published | None = None

    def get(self, key: Key) -> Published | None:
        """The policy of a message, if it is still here."""
        return self._kept.get(key)

    def note(self, msg: Any) -> str | None:
        """Keep the policy of a message, unless it is known; why it is refused, or None."""
        if (msg.trainer_instance, msg.sequence) in self._kept:
            return None
        self._heard.append(msg)
        try:
            policy = checked(msg, self._briefing)
        except PolicyMismatchError as error:
            return f'policy {msg.version!r} of the trainer is refused: {error}'
        self._kept[policy.key] = policy
        if len(self._kept) > _KEPT:
            del self._kept[next(iter(self._kept))]
        if self.latest is None or self._is_abandoned or policy.follows(self.latest):
            self.latest = policy
            self._is_abandoned = False
        return None

    def serve(self, briefing: Briefing) -> list[str]:
        """Keep policies for another fleet or area: what was refused may fit now, or no longer.

        Returns:
            Why policies are refused now.
        """
        heard = [*self._heard]
        self._briefing, self.latest = briefing, None
        self._heard.clear()
        self._kept.clear()
        return [refusal for msg in heard if (refusal := self.note(msg)) is not None]

    def abandon(self) -> None:
        """The trainer is gone: what the next one publishes counts, whatever its clock says."""
        self._is_abandoned = True


class Follower:
    """Flies each mission by the policy that the world names: a policy to the agent."""

    name = TOPIC

    def __init__(self, shelf: Shelf) -> None:
        """Follow what lies on a shelf."""
        self._shelf = shelf
        self._place: tuple[Briefing, int] | None = None
        self.flown: ExploringPolicy | None = None

    @property
    def version(self) -> str:
        """Of the mission that is flown."""
        return '' if self.flown is None else self.flown.version

    def is_ready(self, observation: Any) -> bool:
        """Whether the policy is here that an observation names, if it is a mission's first."""
        return observation.decision > 0 or self._shelf.get(_named_by(observation)) is not None

    def take_up(self, observation: Any) -> None:
        """Fly the mission of its first observation by the policy that this names."""
        policy = self._shelf.get(_named_by(observation))
        if policy is None or self._place is None:
            raise RuntimeError('a mission begins without its policy')
        self.flown = policy.pilot(observation.exploration_key)
        self.flown.begin(*self._place)

    def begin(self, briefing: Briefing, uav: int) -> None:
        """Get ready to fly a UAV, by index, in the next mission."""
        self._place = briefing, uav
        self.flown = None

    def choose(self, belief: Belief, view: LocalView, legal: Row[int]) -> int:
        """What the mission's policy chooses."""
        if self.flown is None:
            raise RuntimeError('a policy must begin a mission before it chooses')
        return self.flown.choose(belief, view, legal)


def _named_by(observation: Any) -> Key:
    return observation.policy_trainer, observation.policy_sequence


def _stamp(msg: Any) -> tuple[int, int]:
    return msg.stamp.sec, msg.stamp.nanosec
