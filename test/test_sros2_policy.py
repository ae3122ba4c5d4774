"""The policy for SROS2 says what the table of topics says, and is of the form that it reads."""

from pathlib import Path
from xml.etree import ElementTree

import pytest

for needed in ('rclpy', 'uav_collect_msgs'):
    pytest.importorskip(needed)

from uav_collect.nodes import topics

from tools.sros2_policy import N_SHIPPED, policy, roles, SHIPPED

pytestmark = pytest.mark.ros


def test_the_shipped_file_is_what_the_tool_writes() -> None:
    assert SHIPPED.read_text() == policy(roles(N_SHIPPED))


@pytest.mark.parametrize('namespace', ['', '/a'])
def test_every_topic_has_one_who_says_it_and_one_who_hears_it(namespace: str) -> None:
    given = roles(3, [namespace])
    said = [name for role in given for name in role.publishes]
    heard = {name for role in given for name in role.subscribes}
    table = {it.name for it in topics.fleet_topics(3, namespace)}
    table |= {topics.world_topics(namespace).recorder.name}
    assert sorted(said) == sorted(table)  # nobody says what another one does
    assert heard == table


def test_an_agent_says_and_hears_nothing_of_other_uavs() -> None:
    for role in roles(3)[1:4]:
        own = role.namespace
        names = [*role.publishes, *role.subscribes]
        assert {name.split('/')[1] for name in names} == {own[1:], 'world', 'trainer'}


def test_a_trainer_hears_all_worlds() -> None:
    *_, trainer = roles(1, ['/a', '/b'])
    assert {'/a/world/epoch', '/b/uav_1/transition'} < {*trainer.subscribes}
    assert trainer.publishes == ('/trainer/policy',)
    assert trainer.asks == ('/a/world/vouch_*', '/b/world/vouch_*')


def test_the_form_is_that_of_sros2() -> None:
    sros2 = pytest.importorskip('sros2.policy', reason='part of a ROS distribution')
    sros2.load_policy(SHIPPED)  # checks it against its schema


def test_enclaves_are_named_once() -> None:
    paths = [it.get('path') for it in ElementTree.parse(SHIPPED).getroot().iter('enclave')]
    assert len({*paths}) == len(paths) == 5 + N_SHIPPED
    assert Path(str(paths[0])).name == 'world_sim'
