"""What users set of the world node."""

from dataclasses import dataclass
import uuid

from rclpy.node import Node
from uav_collect.errors import NodeError
from uav_collect.limits import MAX_SEED
from uav_collect.nodes.parameters import declare, Parameter, values_of, world_instance_of

PARAMETERS = (
    Parameter(
        name='scenario',
        default='paper_10x10',
        description='name of a shipped scenario, or path of a YAML file',
    ),
    Parameter(
        name='seed',
        default=0,
        description='seed of the first mission; each further one adds 1',
        low=0,
        high=MAX_SEED,
    ),
    Parameter(
        name='missions',
        default=1,
        description='missions to fly in a row before the world exits; -1: one after another '
        'without end; 0: only those that /world/control or /world/fly_mission starts, without end',
        low=-1,
        high=1_000_000,
    ),
    Parameter(
        name='max_decisions',
        default=0,
        description='decisions of the fleet after which a mission is cut off, as learners do; '
        '0: never',
        low=0,
        high=1_000_000,
    ),
    Parameter(
        name='real_time_factor',
        default=0.0,
        description='simulated over wall-clock time; 0: as fast as the fleet decides',
        low=0.0,
        high=1000.0,
        in_flight=True,
    ),
    Parameter(
        name='wait_for_agents',
        default=True,
        description='wait for the whole fleet; if false, a few seconds at most: UAVs without an '
        'agent by then fly home at once',
    ),
    Parameter(
        name='decision_timeout_s',
        default=10.0,
        description='wall-clock time [s] that an agent has to answer before the failsafe flies '
        'its UAV home',
        low=0.1,
        high=3600.0,
        in_flight=True,
    ),
    Parameter(
        name='recorders',
        default=0,
        description='recorders that the first mission waits for; for others it waits once they '
        'have said that they are there',
        low=0,
        high=64,
    ),
    Parameter(
        name='recorder_timeout_s',
        default=10.0,
        description='wall-clock time [s] that a mission waits for recorders; then it starts '
        'without them',
        low=0.0,
        high=3600.0,
    ),
    Parameter(
        name='world_instance',
        default='',
        description='UUID of this process, for nodes that take only its missions; a process each; '
        'empty: drawn',
    ),
    Parameter(
        name='output_dir',
        default='',
        description='folder for the mission logs and the resolved scenario, without logs of '
        'another world; empty: none',
    ),
    Parameter(
        name='viewer_rate_hz',
        default=5.0,
        description='how often [Hz, wall clock] markers and grid are published; 0: never',
        low=0.0,
        high=60.0,
    ),
    Parameter(
        name='picture_period_s',
        default=5.0,
        description='simulated time [s] after which they are published too, where somebody '
        'subscribes to them; 0: the wall clock alone counts',
        low=0.0,
        high=3600.0,
    ),
    Parameter(
        name='sample_rate_hz',
        default=2.0,
        description='how often [Hz, simulated time] transforms, odometry, battery and satellite '
        'fix of each UAV are published, where somebody subscribes to them; 0: never, nor its path',
        low=0.0,
        high=100.0,
    ),
)


@dataclass(frozen=True, kw_only=True)
class WorldSettings:
    """What users have set of the world node, by the names of PARAMETERS."""

    scenario: str
    seed: int
    missions: int
    max_decisions: int
    real_time_factor: float
    wait_for_agents: bool
    decision_timeout_s: float
    recorders: int
    recorder_timeout_s: float
    world_instance: str
    output_dir: str
    viewer_rate_hz: float
    picture_period_s: float
    sample_rate_hz: float


def read_settings(node: Node) -> WorldSettings:
    """Declare the parameters and read them, as they are at the start; draw an instance not given.

    Raises:
        NodeError: the instance is no UUID, or there are not so many seeds.
    """
    declare(node, PARAMETERS)
    instance = world_instance_of(node) or str(uuid.uuid4())
    settings = WorldSettings(**{**values_of(node, PARAMETERS), 'world_instance': instance})
    most = MAX_SEED + 1 - max(1, settings.missions)
    if settings.seed > most:
        raise NodeError(
            f'seed is {settings.seed}: must be at most {most} for {settings.missions} missions'
        )
    return settings
