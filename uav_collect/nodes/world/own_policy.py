"""The policy that was refined for what a world flies; agents that choose by themselves try it."""

from array import array
from collections.abc import Callable
import hashlib
from pathlib import Path

from uav_collect.errors import PolicyMismatchError
from uav_collect.uav.briefing import Briefing
from uav_collect.uav.own_policy import own_policies
from uav_collect.uav.policy_file import load_policy, policy_bytes
from uav_collect_msgs.msg import Policy


def own_policy_msg(scenario: str, briefing: Briefing, warn: Callable[[str], object]) -> Policy:
    """The policy that lies beside a scenario's file, as a message; without content: none does.

    Args:
        scenario: name of a shipped one, beside which none lies, or path of a file.
        briefing: of its fleet.
        warn: is told why a policy cannot fly that lies there, in a line.
    """
    for file in own_policies(scenario, briefing.n_uavs):
        try:
            policy = load_policy(Path(file))
        except PolicyMismatchError as error:
            warn(f'it cannot be chosen: {error}')
            continue
        misfit = policy.header.misfit(briefing)
        if misfit is not None:
            warn(f'it cannot be chosen: {file}: {misfit}')
            continue
        content = policy_bytes(policy)
        return Policy(
            version=policy.header.version,
            content=array('B', content),
            sha256=hashlib.sha256(content).hexdigest(),
        )
    return Policy()
