"""The table of topics: nothing that a mission needs may be lost."""

import pytest

for needed in ('rclpy', 'uav_collect_msgs'):
    pytest.importorskip(needed)

from rclpy.qos import DurabilityPolicy, ReliabilityPolicy
from uav_collect.nodes import topics
from uav_collect_msgs.srv import ControlMission, InjectFault, Join, Vouch

pytestmark = pytest.mark.ros


def test_a_fleet_has_ten_topics_per_uav_and_nine_of_its_own() -> None:
    names = [topic.name for topic in topics.fleet_topics(16)]
    assert len(set(names)) == len(names) == 9 + 16 * 10
    assert '/uav_16/radio_rx' in names


def test_only_the_clock_may_lose_messages() -> None:
    unreliable = [
        topic.name
        for topic in topics.fleet_topics(1)
        if topic.qos.reliability != ReliabilityPolicy.RELIABLE
    ]
    assert unreliable == ['/clock']


def test_who_starts_late_gets_all_but_what_counts_now() -> None:
    forgotten = [
        topic.name
        for topic in topics.fleet_topics(1)
        if topic.qos.durability != DurabilityPolicy.TRANSIENT_LOCAL
    ]
    assert forgotten == ['/clock', '/diagnostics', '/uav_1/refusal']


def test_a_uav_of_a_whole_mission_fits_its_history() -> None:
    own = topics.uav_topics(1)
    for topic in topics.topics_of_uav(1):
        if topic in (own.refusal, own.path):  # nobody needs old ones
            continue
        assert topic.qos.depth >= 1000
    assert topics.EPOCH.qos.depth >= 10_000


def test_the_death_of_an_agent_and_of_the_world_is_noticed() -> None:
    for topic in (topics.uav_topics(1).command, topics.SCENARIO):
        assert topic.qos.liveliness_lease_duration.nanoseconds == 2_000_000_000


def test_types_are_named_as_ros_names_them() -> None:
    assert topics.EPOCH.type_name == 'uav_collect_msgs/msg/Epoch'
    assert topics.CLOCK.type_name == 'rosgraph_msgs/msg/Clock'


def test_every_message_of_a_mission_ends_with_a_seal() -> None:
    own = [it.message for it in (*topics.fleet_topics(1), topics.RECORDER)]
    asked = ControlMission, InjectFault, Join, Vouch
    services = [part for it in asked for part in (it.Request, it.Response)]
    ends = {
        message.__name__: [*message.get_fields_and_field_types().items()][-1]
        for message in (*own, *services)
        if 'uav_collect_msgs' in message.__module__
    }
    assert len(ends) == 10 + 8
    assert set(ends.values()) == {('seal', 'uav_collect_msgs/Seal')}


def test_two_worlds_share_what_a_trainer_and_diagnostics_say_and_nothing_else() -> None:
    alone, one, other = (
        {topic.name for topic in topics.fleet_topics(2, namespace)}
        for namespace in ('', '/a', '/north/b')
    )
    assert one & other == one & alone == {'/diagnostics', '/trainer/policy'}
    assert {'/a/clock', '/a/world/epoch', '/a/uav_1/transition'} < one
    assert topics.world_topics('/a').join_service == '/a/world/join'


@pytest.mark.parametrize(
    ('node', 'uav', 'world'),
    [
        ('/', 0, ''),
        ('/a', 0, '/a'),
        ('/uav_1', 1, ''),
        ('/a', 1, '/a'),
        ('/a/uav_1', 1, '/a'),
        ('/uav_1', 11, '/uav_1'),
    ],
)
def test_a_node_belongs_to_the_world_of_its_namespace(node: str, uav: int, world: str) -> None:
    assert topics.world_of(node, uav) == world
