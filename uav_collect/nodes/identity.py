"""Which world is which: of two in one ROS domain, the later one gives way."""

from dataclasses import dataclass
import math
from typing import Any

from uav_collect.nodes.convert import stamp
from uav_collect.scenario.load import fingerprint
from uav_collect.scenario.site import Site
from uav_collect_msgs.msg import Scenario as ScenarioMsg

_SHORT = 8  # characters of an instance that the ids of its missions begin with


@dataclass(frozen=True, kw_only=True)
class WorldIdentity:
    """One process of the world node."""

    started_s: float  # wall-clock time of its start
    instance: str  # UUID

    def gives_way_to(self, other: 'WorldIdentity') -> bool:
        """Whether this is the later one; the instance breaks ties."""
        return (self.started_s, self.instance) > (other.started_s, other.instance)

    def mission_id(self, index: int) -> str:
        """Names the mission with a running number."""
        return f'{self.instance[:_SHORT]}-{index}'

    def refusal_of(self, mission_id: str, decision: int) -> str:
        """Why a decision is refused that is not of the mission in flight."""
        if mission_id.startswith(f'{self.instance[:_SHORT]}-'):
            return f'decision {decision} is of mission {mission_id}, which is not in flight'
        return f'mission {mission_id!r} is not of this world'


NO_WORLD = WorldIdentity(started_s=math.inf, instance='')  # every world comes before it


def identity_of(msg: Any) -> WorldIdentity:
    """The world that has published a scenario."""
    started_s = msg.stamp.sec + msg.stamp.nanosec * 1e-9
    return WorldIdentity(started_s=started_s, instance=msg.world_instance)


def rival_warning(msg: Any, *, gives_way: bool) -> str:
    """What to log when another world publishes its scenario."""
    name = str(msg.yaml).partition('\n')[0].removeprefix('name:').strip()
    text = f'another world_sim flies scenario {name} in this ROS domain'
    if gives_way:
        return f'{text}: this one gives way; set another ROS_DOMAIN_ID'
    return f'{text}; it came later and has to give way'


def scenario_msg(identity: WorldIdentity, site: Site) -> ScenarioMsg:
    """What a world publishes of itself, its scenario and its site."""
    return ScenarioMsg(
        stamp=stamp(identity.started_s),
        world_instance=identity.instance,
        yaml=site.scenario.to_yaml(),
        fingerprint=fingerprint(site.scenario),
        sensor_id=list(site.sensor_ids),
        sensor_x_m=site.position_m[:, 0].tolist(),
        sensor_y_m=site.position_m[:, 1].tolist(),
    )
