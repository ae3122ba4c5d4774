"""Whole recordings made without ROS: every message that a mission flown in this process has."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from bags import ENDED, HandMadeBag, STARTED
import numpy as np
from uav_collect.analysis.metrics import mission_metrics, OUTCOME_CODES
from uav_collect.missions.reflight import FlownBy, fly_again
from uav_collect.missions.rollout import fly
from uav_collect.missions.simulation import fly_agents, Simulation
from uav_collect.recording.mission_log import header_line, MissionLog
from uav_collect.recording.mission_messages import MessagePlace
from uav_collect.scenario.load import fingerprint
from uav_collect.scenario.site import Site
from uav_collect.uav.agent import Agent, allocator_named
from uav_collect.uav.briefing import briefing_of
from uav_collect.uav.observation import Layout
from uav_collect.uav.policy import guard_for, policy_named

WORLD = 'world'
LAYOUT = Layout.EGOCENTRIC
_NAMES = {
    'epoch': 'Epoch',
    'observation': 'Observation',
    'command': 'Command',
    'transition': 'Transition',
    'radio_tx': 'RadioMessage',
    'radio_rx': 'RadioMessage',
}
_NUMBERS = {'radio_tx': 'sequence', 'radio_rx': 'delivery', 'epoch': 'event'}
_BYTES = ('fault', 'fault_uav', 'complete', 'seen', 'uav_complete', 'true_complete', 'uav_phase')
_TYPES = {'sensor': np.uint32, 'legal': np.bool_, 'observation': np.float32, 'heard': np.uint8}

Values = dict[str, Any]


def messages_of(site: Site, log: MissionLog) -> dict[MessagePlace, Values]:
    """What all messages of a mission say, field by field; rules or shipped policies flew it."""
    crew = []
    for uav in log.header.uavs:
        policy = policy_named(uav.policy)
        guard_after = guard_for(policy, uav.guard_after, briefing_of(site))
        crew.append(FlownBy(policy=policy, allocator=uav.allocator, guard_after=guard_after))
    flown = fly_again(site, log.header, crew, layouts=[LAYOUT])
    assert flown.log.to_jsonl() == log.to_jsonl()
    said = {place: dict(values) for place, values in flown.messages.items()}
    for place, values in said.items():
        values[_NUMBERS.get(place.kind, 'decision')] = place.number
        if place.kind == 'transition':
            values['layout'] = LAYOUT.label
            values['observation'] = values['observation'][LAYOUT.label]
        if place.kind == 'epoch':
            mask = int(log.events['heard'][place.number])
            values['heard'] = [index + 1 for index in range(64) if mask >> index & 1]
    return said


def flown_with_injected(
    site: Site, policy: str, before: int, *faults: tuple[str, int], seed: int = 0
) -> MissionLog:
    """A mission in which faults were injected before an event: kinds, and indices of UAVs."""
    [plain] = fly(site, [seed], policy)
    simulation = Simulation(site, seed)
    agents = [
        Agent(simulation.briefing, index, policy_named(policy), allocator_named(uav.allocator))
        for index, uav in enumerate(plain.header.uavs)
    ]
    flight = fly_agents(simulation, agents)
    for _ in range(before):
        next(flight)
    for kind, uav in faults:
        simulation.inject(kind, uav)
    assert len([*flight]) > 2
    return simulation.log(plain.header)


def start_of(site: Site, log: MissionLog, demand_bit: Sequence[float]) -> Values:
    """What is said of the mission at its start."""
    return {
        'phase': STARTED,
        'world_instance': WORLD,
        'scenario_fingerprint': fingerprint(site.scenario),
        'seed': log.header.mission_seed,
        'log_header': header_line(log.header),
        'demand_bit': np.array(demand_bit),
        'total_bit': log.header.total_bit,
    }


def end_of(site: Site, log: MissionLog, demand_bit: Sequence[float]) -> Values:
    """What is said of the mission at its end, but of each UAV."""
    metrics = mission_metrics(log)
    names = ('collected_bit', 'completion_s', 'energy_j', 'efficiency_bit_per_j', 'n_decisions')
    figures = {name: getattr(metrics, name) for name in names}
    uavs = [
        {
            'uav': uav.id,
            'outcome': OUTCOME_CODES[uav.outcome],
            'decisions': uav.n_decisions,
            'guarded': uav.n_guarded,
            **{
                name: getattr(uav, name)
                for name in (
                    *('speed_mps', 'energy_budget_j', 'energy_j', 'collected_bit'),
                    *('flight_s', 'hover_s'),
                )
            },
        }
        for uav in metrics.uavs
    ]
    return {**start_of(site, log, demand_bit), **figures, 'phase': ENDED, 'uavs': uavs}


def write_bag(
    folder: Path,
    site: Site,
    missions: Mapping[str, tuple[list[Values], dict[MessagePlace, Values]]],
) -> Path:
    """Write a bag.

    Args:
        missions: by id, what is said of start and end, and all other messages.
    """
    bag = HandMadeBag(folder)
    bag.add_scenario(site, world=WORLD)
    for mission_id, (phases, said) in missions.items():
        bag.add('/world/mission', 'Mission', mission_id=mission_id, **phases[0])
        for place, values in said.items():
            fields = {name: _field(name, value) for name, value in values.items()}
            topic = f'/uav_{place.uav}/{place.kind}' if place.uav else f'/world/{place.kind}'
            name = _NAMES[place.kind]
            bag.add(topic, name, **{'mission_id': mission_id, **_stamped(fields), **fields})
        for phase in phases[1:]:
            bag.add('/world/mission', 'Mission', mission_id=mission_id, **phase)
    bag.writer.close()
    return folder


def _stamped(fields: Values) -> Values:
    if 'time_s' not in fields:
        return {}
    sec, nanosec = divmod(round(fields['time_s'] * 1e9), 1_000_000_000)
    return {'stamp': {'sec': sec, 'nanosec': nanosec}}


def _field(name: str, value: Any) -> Any:  # noqa: ANN401 - any field
    if not isinstance(value, list):
        return value
    return np.array(value, np.uint8 if name in _BYTES else _TYPES.get(name, np.float64))
