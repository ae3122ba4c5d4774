"""Writes what SROS2 lets each process of a fleet say and hear, from the table of topics.

python tools/sros2_policy.py [--uavs N] [--worlds NAME ...] [--output FILE]

It needs the messages, so source install/setup.sh before.
"""

import argparse
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
import sys
from xml.etree import ElementTree  # nosec B405 # it writes XML, and reads none

from uav_collect.limits import MAX_UAVS
from uav_collect.nodes.sealing import has_seal
from uav_collect.nodes.topics import (
    fleet_topics,
    is_learned_from,
    POLICY,
    Topic,
    topics_of_uav,
    world_topics,
    WorldTopics,
)

SHIPPED = Path(__file__).resolve().parents[1] / 'config' / 'sros2' / 'fleet.policy.xml'
N_SHIPPED = 2  # UAVs of the shipped file

_VERSION = '0.2.0'  # of the form of policies
_ROOT = '/uav_collect'  # before the names of all enclaves
# What every node of rclpy has.
_OWN_TOPICS = ('/rosout', '/parameter_events')
_OWN_SERVICES = (
    *('~/describe_parameters', '~/get_parameter_types', '~/get_parameters', '~/list_parameters'),
    *('~/set_parameters', '~/set_parameters_atomically', '~/get_type_description'),
)
_COMMENT = f"""
What SROS2 lets the processes of a fleet say and hear: an enclave each. Written by
tools/sros2_policy.py for {N_SHIPPED} UAVs and a world without a name; it writes those of others.
"""


@dataclass(frozen=True, kw_only=True)
class Role:
    """What one process may do; names as ROS has them, `~` for its own, `*` for anything."""

    enclave: str
    namespace: str
    node: str
    publishes: tuple[str, ...] = ()
    subscribes: tuple[str, ...] = ()
    serves: tuple[str, ...] = ()
    asks: tuple[str, ...] = ()
    executes: tuple[str, ...] = ()  # actions that it serves
    calls: tuple[str, ...] = ()  # actions that it has goals for


def roles(n_uavs: int, namespaces: Sequence[str] = ('',)) -> list[Role]:
    """The processes of fleets, their viewers and their trainer.

    Args:
        n_uavs: of each fleet.
        namespaces: of the worlds, '' or such as '/a'.
    """
    fleets = [_fleet_roles(n_uavs, namespace) for namespace in namespaces]
    return [*(role for fleet in fleets for role in fleet), _trainer_role(n_uavs, namespaces)]


def _fleet_roles(n_uavs: int, namespace: str) -> list[Role]:
    world, uavs = world_topics(namespace), range(1, n_uavs + 1)
    return [
        _world_role(world, uavs),
        *(_agent_role(world, uav) for uav in uavs),
        Role(
            enclave=f'{_ROOT}{namespace}/recorder',
            namespace=namespace or '/',
            node='recorder',
            publishes=(world.recorder.name,),
            subscribes=_names(fleet_topics(n_uavs, namespace)),
        ),
        Role(
            enclave=f'{_ROOT}{namespace}/control',
            namespace=namespace or '/',
            node='control',
            subscribes=(world.scenario.name,),
            asks=(*_steered(world), f'{world.vouch_prefix}*'),
            calls=(world.fly_mission,),
        ),
        Role(
            enclave=f'{_ROOT}{namespace}/viewer',
            namespace=namespace or '/',
            node='viewer',
            subscribes=_names(
                it
                for it in fleet_topics(n_uavs, namespace)
                if not has_seal(it.message) or it in (world.scenario, world.mission, world.epoch)
            ),
            asks=(world.control_service, f'{world.vouch_prefix}*', _pace_service(world)),
        ),
    ]


def _world_role(world: WorldTopics, uavs: Iterable[int]) -> Role:
    said = [topic for topic in world.recorded() if topic != POLICY]
    heard = [world.scenario, world.recorder, POLICY]
    for uav in uavs:
        own = world.uav(uav)
        heard += [own.command, own.radio_tx]
        to_uav = topics_of_uav(uav, world.namespace)
        said += [it for it in to_uav if it not in (own.command, own.radio_tx, own.transition)]
    return Role(
        enclave=f'{_ROOT}{world.namespace}/world_sim',
        namespace=world.namespace or '/',
        node='world_sim',
        publishes=_names(said),
        subscribes=_names(heard),
        serves=(*_steered(world), world.join_service, f'{world.vouch_prefix}*'),
        asks=(f'{world.vouch_prefix}*',),  # of another world of its name
        executes=(world.fly_mission,),
    )


def _steered(world: WorldTopics) -> tuple[str, ...]:
    """The services by which people steer a world."""
    return world.control_service, world.inject_service


def _pace_service(world: WorldTopics) -> str:
    """The service by which the parameters of a world are set, its pace among them."""
    return f'{world.namespace}/world_sim/set_parameters'


def _agent_role(world: WorldTopics, uav: int) -> Role:
    own = world.uav(uav)
    return Role(
        enclave=f'{_ROOT}{world.namespace}/uav_{uav}',
        namespace=f'{world.namespace}/uav_{uav}',
        node='uav_agent',
        publishes=_names([own.command, own.radio_tx, own.transition]),
        subscribes=_names([world.scenario, POLICY, own.observation, own.radio_rx, own.refusal]),
        asks=(world.join_service, f'{world.vouch_prefix}*'),
    )


def _trainer_role(n_uavs: int, namespaces: Sequence[str]) -> Role:
    flown = [topic for each in namespaces for topic in fleet_topics(n_uavs, each)]
    learned = filter(is_learned_from, flown)
    return Role(
        enclave=f'{_ROOT}/trainer',
        namespace='/',
        node='trainer',
        publishes=(POLICY.name,),
        subscribes=_names(topic for topic in learned if topic != POLICY),
        asks=tuple(f'{world_topics(each).vouch_prefix}*' for each in namespaces),
    )


def _names(topics: Iterable[Topic]) -> tuple[str, ...]:
    return tuple(sorted({topic.name for topic in topics}))


def of_every_node(role: Role, verb: str) -> list[str]:
    """What a node of rclpy does besides: publishes, subscribes, serves or asks."""
    own = {'publishes': _OWN_TOPICS, 'serves': _OWN_SERVICES}.get(verb, ())
    place = f'{role.namespace.rstrip("/")}/{role.node}'
    return [name.replace('~', place) for name in own]


def policy(roles: Sequence[Role]) -> str:
    """The policy as `ros2 security create_permission` reads it."""
    root = ElementTree.Element('policy', version=_VERSION)
    root.append(ElementTree.Comment(_COMMENT))
    enclaves = ElementTree.SubElement(root, 'enclaves')
    for role in roles:
        enclave = ElementTree.SubElement(enclaves, 'enclave', path=role.enclave)
        profiles = ElementTree.SubElement(enclave, 'profiles')
        profile = ElementTree.SubElement(profiles, 'profile', ns=role.namespace, node=role.node)
        for names, element, verb in (
            ((*role.publishes, *_OWN_TOPICS), 'topic', 'publish'),
            (role.subscribes, 'topic', 'subscribe'),
            ((*role.serves, *_OWN_SERVICES), 'service', 'reply'),
            (role.asks, 'service', 'request'),
            (role.executes, 'action', 'execute'),
            (role.calls, 'action', 'call'),
        ):
            listed = ElementTree.SubElement(profile, f'{element}s', {verb: 'ALLOW'})
            for name in names:
                ElementTree.SubElement(listed, element).text = name
            if not names:
                profile.remove(listed)
    ElementTree.indent(root)
    text = ElementTree.tostring(root, encoding='unicode')
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{text}\n'


def main() -> None:
    """Write a policy."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--uavs', type=int, default=N_SHIPPED, choices=range(1, MAX_UAVS + 1))
    parser.add_argument('--worlds', nargs='+', default=[''], help='names of worlds that have one')
    parser.add_argument('--output', type=Path, help='file to write; standard output')
    given = parser.parse_args()
    text = policy(roles(given.uavs, [f'/{name}' if name else '' for name in given.worlds]))
    if given.output is None:
        sys.stdout.write(text)
    else:
        given.output.write_text(text, encoding='utf-8')


if __name__ == '__main__':
    main()
