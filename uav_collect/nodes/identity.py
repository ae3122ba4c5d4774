"""Which world is which: of two in one ROS domain, the later one gives way."""

from dataclasses import dataclass
import hashlib
import math
import os
from typing import Any

from uav_collect.errors import in_one_line
from uav_collect.nodes.convert import stamp
from uav_collect.scenario.load import fingerprint
from uav_collect.scenario.site import Site
from uav_collect_msgs.msg import Scenario as ScenarioMsg

_DIGITS = 9  # of a mission's running number
_NAME = 64  # characters of a scenario's name that are shown
_SHORT = 8  # hexadecimal digits by which a world is named in the ids of its missions


@dataclass(frozen=True, kw_only=True)
class WorldIdentity:
    """One process of the world node."""

    started_s: float  # wall-clock time of its start
    instance: str  # UUID

    def gives_way_to(self, other: 'WorldIdentity') -> bool:
        """Whether this is the later one; the instance breaks ties."""
        return (self.started_s, self.instance) > (other.started_s, other.instance)

    @property
    def short(self) -> str:
        """What missions and services of the world are named by."""
        return short_instance(self.instance)

    def mission_id(self, index: int) -> str:
        """Names the mission with a running number."""
        return f'{self.short}-{index}'

    def may_own(self, mission_id: str) -> bool:
        """Whether a mission is called like those of this world, started or not."""
        return mission_id.startswith(f'{self.short}-')

    def owns(self, mission_id: str, n_started: int) -> bool:
        """Whether a mission is one of the so many that this world has started."""
        _, _, number = mission_id.rpartition('-')
        is_number = number.isdecimal() and len(number) <= _DIGITS
        return is_number and int(number) < n_started and self.mission_id(int(number)) == mission_id

    def refusal_of(self, mission_id: str, decision: int) -> str:
        """Why a decision is refused that is not of the mission in flight."""
        if self.may_own(mission_id):
            return f'decision {decision} is of mission {mission_id}, which is not in flight'
        return f'mission {mission_id!r} is not of this world'


def short_instance(instance: str) -> str:
    """A digest of an instance, by which missions and services of the world are named.

    Instances that users give may begin alike: those that are counted, or made of the time.
    """
    return hashlib.sha256(instance.encode()).hexdigest()[:_SHORT]


NO_WORLD = WorldIdentity(started_s=math.inf, instance='')  # every world comes before it


def identity_of(msg: Any) -> WorldIdentity:
    """The world that has published a scenario."""
    started_s = msg.stamp.sec + msg.stamp.nanosec * 1e-9
    return WorldIdentity(started_s=started_s, instance=msg.world_instance)


def silent_world(msg: Any) -> str:
    """What to log when nobody vouches for the world of a scenario."""
    return (
        f'a scenario {_name_in(msg)} is ignored, for its world does not answer: a recording that'
        ' is played back, a world that is gone, or one with another key (UAV_COLLECT_KEY_FILE)'
    )


def place_of(namespace: str) -> str:
    """Where a world of a namespace, '' or such as '/a', is looked for, for people."""
    domain = os.environ.get('ROS_DOMAIN_ID', '0')
    return f'ROS domain {domain}{f", namespace {namespace}" if namespace else ""}'


def other_world(msg: Any) -> str:
    """What to log when a scenario is not of the only world that counts."""
    return (
        f'a scenario {_name_in(msg)} is ignored: it is of another world than world_instance names'
    )


def rival_warning(msg: Any, *, gives_way: bool) -> str:
    """What to log when another world publishes its scenario."""
    text = f'another world_sim flies scenario {_name_in(msg)} in this ROS domain'
    if gives_way:
        return f'{text}: this one gives way; set another ROS_DOMAIN_ID, or name it (--world a)'
    return f'{text}; it came later and has to give way'


def scenario_msg(identity: WorldIdentity, site: Site, vouch_service: str) -> ScenarioMsg:
    """What a world publishes of itself, its scenario and its site."""
    return ScenarioMsg(
        stamp=stamp(identity.started_s),
        world_instance=identity.instance,
        vouch_service=vouch_service,
        yaml=site.scenario.to_yaml(),
        fingerprint=fingerprint(site.scenario),
        n_uavs=site.scenario.n_uavs,
        sensor_id=list(site.sensor_ids),
        sensor_x_m=site.position_m[:, 0].tolist(),
        sensor_y_m=site.position_m[:, 1].tolist(),
    )


def _name_in(msg: Any) -> str:
    """The name of the scenario that a message holds, as far as one can tell."""
    return in_one_line(msg.yaml.partition('\n')[0].removeprefix('name:'))[:_NAME]
