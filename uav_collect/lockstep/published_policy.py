"""Policies that trainers publish: which of them count, and how a UAV flies each mission by one."""

from collections import deque
from dataclasses import dataclass
import hashlib
import math
from typing import Any

from uav_collect.config.yaml_text import shown
from uav_collect.errors import PolicyMismatchError
from uav_collect.kernels.arrays import Row
from uav_collect.uav.belief import Belief
from uav_collect.uav.briefing import Briefing
from uav_collect.uav.named_code import of_published
from uav_collect.uav.policy import TOPIC
from uav_collect.uav.policy_file import policy_from_bytes
from uav_collect.uav.policy_network import (
    ExploringPolicy,
    flown_version,
    FrozenPolicy,
    LearnedPolicy,
)
from uav_collect.uav.view import LocalView

_N_KEPT = 4  # policies; a mission may begin with one that is no longer the latest

PolicyKey = tuple[str, int]  # trainer_instance and sequence of a Policy message


@dataclass(frozen=True, kw_only=True)
class PublishedPolicy:
    """A Policy message that was checked."""

    message: Any
    frozen: FrozenPolicy

    @property
    def key(self) -> PolicyKey:
        """Trainer and sequence, by which observations name it."""
        return self.message.trainer_instance, self.message.sequence

    @property
    def version(self) -> str:
        """What commands, logs and transitions say."""
        return flown_version(self.frozen.header.version, self.message.epsilon)

    def is_newer_than(self, other: 'PublishedPolicy') -> bool:
        """Whether it was published after another one."""
        (trainer, sequence), (other_trainer, other_sequence) = self.key, other.key
        if trainer == other_trainer:
            return bool(sequence > other_sequence)
        return _stamp(self.message) > _stamp(other.message)

    def for_mission(self, mission_seed: int) -> ExploringPolicy:
        """What flies a UAV in a mission; it explores as the message says."""
        return ExploringPolicy(
            LearnedPolicy(self.version, self.frozen),
            self.message.epsilon,
            self.message.hover_share,
            mission_seed,
            advice_share_of(self.message),
        )


def advice_share_of(msg: Any) -> float:
    """The share of advice in exploration; recordings of before have no such field."""
    return float(getattr(msg, 'advice_share', 0.0))


def checked_policy(msg: Any, briefing: Briefing) -> PublishedPolicy:
    """Check a Policy message and read the policy in it.

    Raises:
        PolicyMismatchError: it is not whole, or cannot fly this fleet over this area.
    """
    content = bytes(msg.content)
    digest = hashlib.sha256(content).hexdigest()
    if digest != msg.sha256:
        raise PolicyMismatchError(f'its SHA-256 is {digest[:8]}..., not {msg.sha256[:8]}...')
    with of_published():
        frozen = policy_from_bytes(content)
    if frozen.header.version != msg.version:
        raise PolicyMismatchError(f'its file is of version {shown(frozen.header.version)}')
    misfit = frozen.header.misfit(briefing)
    if misfit is not None:
        raise PolicyMismatchError(misfit)
    if not 0.0 <= msg.epsilon <= 1.0:
        raise PolicyMismatchError(f'epsilon is {msg.epsilon}: must be 0 to 1')
    if not (math.isfinite(msg.hover_share) and msg.hover_share <= 1.0):
        raise PolicyMismatchError(f'hover_share is {msg.hover_share}: must be at most 1')
    if not 0.0 <= advice_share_of(msg) <= 1.0:
        raise PolicyMismatchError(f'advice_share is {msg.advice_share}: must be 0 to 1')
    return PublishedPolicy(message=msg, frozen=frozen)


class PolicyStore:
    """The latest policies that one world, or one of its agents, has received."""

    def __init__(self, briefing: Briefing) -> None:
        """Keep policies for a fleet and its area."""
        self._briefing = briefing
        # Messages, those refused included, and None where a trainer was gone.
        self._received: deque[Any] = deque(maxlen=2 * _N_KEPT)
        self._kept: dict[PolicyKey, PublishedPolicy] = {}  # in the order they came
        self._is_trainer_gone = False
        self.latest: PublishedPolicy | None = None

    def get(self, key: PolicyKey) -> PublishedPolicy | None:
        """The policy of a message, if it is still here."""
        return self._kept.get(key)

    def add(self, msg: Any) -> str | None:
        """Keep the policy of a message, unless it is known; why it is refused, or None."""
        if (msg.trainer_instance, msg.sequence) in self._kept:
            return None
        self._received.append(msg)
        try:
            policy = checked_policy(msg, self._briefing)
        except PolicyMismatchError as error:
            return f'policy {shown(msg.version)} of the trainer is refused: {error}'
        self._kept[policy.key] = policy
        if len(self._kept) > _N_KEPT:
            del self._kept[next(iter(self._kept))]
        if self.latest is None or self._is_trainer_gone or policy.is_newer_than(self.latest):
            self.latest = policy
            self._is_trainer_gone = False
        return None

    def recheck(self, briefing: Briefing) -> list[str]:
        """Keep policies for another fleet or area: what was refused may fit now, or no longer.

        Returns:
            Why policies are refused now.
        """
        received = [*self._received]
        self._briefing, self.latest = briefing, None
        self._received.clear()
        self._kept.clear()
        self._is_trainer_gone = False
        refusals = []
        for msg in received:
            if msg is None:
                self.mark_trainer_gone()
            elif (refusal := self.add(msg)) is not None:
                refusals.append(refusal)
        return refusals

    def mark_trainer_gone(self) -> None:
        """Let what the next trainer publishes count, whatever its clock says."""
        if not self._is_trainer_gone:
            self._received.append(None)
        self._is_trainer_gone = True


class TopicPolicy:
    """Flies each mission by the published policy that the world names: a policy to the agent."""

    name = TOPIC

    def __init__(self, store: PolicyStore) -> None:
        """Fly no policy yet; missions name those in the store."""
        self._store = store
        self._place: tuple[Briefing, int] | None = None
        self.current: ExploringPolicy | None = None

    @property
    def version(self) -> str:
        """Version of what flies the mission; empty before that is selected."""
        return '' if self.current is None else self.current.version

    def is_ready_for(self, observation: Any) -> bool:
        """Whether the policy is here that an observation names, if it is a mission's first."""
        return observation.decision > 0 or self._store.get(_named_by(observation)) is not None

    def select(self, observation: Any) -> None:
        """Fly the mission of its first observation by the policy that this names."""
        policy = self._store.get(_named_by(observation))
        if policy is None or self._place is None:
            raise RuntimeError('a mission begins without its policy')
        self.current = policy.for_mission(observation.exploration_key)
        self.current.begin(*self._place)

    def begin(self, briefing: Briefing, uav: int) -> None:
        """Get ready to fly a UAV, by index, in the next mission."""
        self._place = briefing, uav
        self.current = None

    def choose(self, belief: Belief, view: LocalView, legal: Row[int]) -> int:
        """What the mission's policy chooses."""
        if self.current is None:
            raise RuntimeError('a policy must begin a mission before it chooses')
        return self.current.choose(belief, view, legal)


def _named_by(observation: Any) -> PolicyKey:
    return observation.policy_trainer, observation.policy_sequence


def _stamp(msg: Any) -> tuple[int, int]:
    return msg.stamp.sec, msg.stamp.nanosec
