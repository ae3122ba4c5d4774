"""Which world is which, and whose a mission is."""

import re
import uuid

import pytest

pytest.importorskip('uav_collect_msgs')

from uav_collect.nodes.identity import WorldIdentity


def world(number: int) -> WorldIdentity:
    return WorldIdentity(started_s=0.0, instance=str(uuid.UUID(int=number)))


def test_worlds_whose_instances_begin_alike_have_missions_and_services_of_their_own() -> None:
    one, other = world(1), world(2)
    assert one.short != other.short
    assert one.owns(one.mission_id(7), 8)
    assert not other.may_own(one.mission_id(7))
    assert not other.owns(one.mission_id(7), 8)


def test_the_id_of_a_mission_is_eight_digits_of_its_world_and_a_number() -> None:
    assert re.fullmatch('[0-9a-f]{8}-12', world(1).mission_id(12))
    assert world(1).mission_id(12) == world(1).mission_id(12)
