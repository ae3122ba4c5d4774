"""The policies that teach a training, by name and version."""

from collections.abc import Iterator

from uav_collect.errors import PolicyMismatchError
from uav_collect.training.config import TrainingConfig
from uav_collect.uav.policy import NamedPolicy, policy_named
from uav_collect.uav.policy_network import LearnedPolicy

_DIGITS = 12  # of a digest


def teachers_of(config: TrainingConfig, algorithm: str) -> Iterator[tuple[str, NamedPolicy]]:
    """Each teacher with its name in the settings; none unless it learns by imitation.

    Raises:
        PolicyMismatchError: a teacher is unknown or broken.
    """
    if algorithm != 'imitation' or config.imitation is None:
        return
    for name in config.imitation.teachers:
        try:
            yield name, policy_named(name)
        except PolicyMismatchError as error:
            raise PolicyMismatchError(f'imitation.teachers: {error}') from error


def teacher_labels(config: TrainingConfig, algorithm: str) -> tuple[str, ...]:
    """Each teacher as name@version: of a learned one its digest, of a user's code its file's.

    Raises:
        PolicyMismatchError: a teacher is unknown or broken.
    """
    return tuple(f'{name}@{_version(it)}' for name, it in teachers_of(config, algorithm))


def _version(policy: NamedPolicy) -> str:
    if isinstance(policy, LearnedPolicy):
        return policy.frozen.digest[:_DIGITS]
    return policy.version
