"""Faults injected in flight are in the log, which the same faults give again to the byte."""

from collections.abc import Callable
from pathlib import Path
import signal
from typing import Any

from fleets import Fleet, Listener, listener, Pilots, scenario_of
from processes import Processes
import pytest
from uav_collect.missions.event_log import mission_header
from uav_collect.missions.simulation import FAULT_DECISION
from uav_collect.recording.mission_log import from_jsonl, MissionLog
from uav_collect.scenario.model import FAULT_KINDS, Scenario
from uav_collect.uav import action_codes

pytestmark = pytest.mark.ros

SEED = 3


def flown_with(scenario: Scenario, recorded: MissionLog) -> bytes:
    """The mission in this process, each recorded fault injected before its first event."""
    pilots, waiting = Pilots(scenario, SEED, 'sweep'), [*recorded.faults]
    simulation = pilots.simulation
    while not simulation.is_over:
        while waiting and waiting[0].event == simulation.n_events:
            fault = waiting.pop(0)
            simulation.inject(fault.fault, fault.uav - 1)
        event = simulation.next_event()
        assert event is not None
        simulation.start(event, FAULT_DECISION if event.is_gone else pilots.decide(event))
    flown_by = ['sweep'] * 3, ['exact'] * 3, [action_codes.NONE] * 3
    header = mission_header(scenario, SEED, simulation.demand_bit, *flown_by)
    return simulation.log(header).to_jsonl()


def injector(heard: Listener) -> Callable[[int, str], Any]:
    """What asks the world to inject a fault, and gives its answer."""
    from uav_collect.nodes.topics import INJECT_SERVICE
    from uav_collect_msgs.srv import InjectFault

    client = heard.node.create_client(InjectFault, INJECT_SERVICE)
    heard.wait_until(client.service_is_ready)

    def inject(uav: int, fault: str) -> Any:  # noqa: ANN401 - a message
        call = client.call_async(InjectFault.Request(uav=uav, fault=fault))
        heard.wait_until(call.done)
        return call.result()

    return inject


def test_injected_faults_are_logged_and_give_the_same_mission_again(
    processes: Processes, tmp_path: Path
) -> None:
    scenario = scenario_of(3, radio__loss_share=0.2, radio__delay_s=[2.0, 1.0])
    fleet = Fleet(processes=processes, scenario=scenario, folder=tmp_path / 'run')
    world = fleet.start_world(seed=SEED, missions=1, decision_timeout_s=600.0)
    held = fleet.start_agent(1)
    world.wait_for('UAV 1: .* joined')
    held.send(signal.SIGSTOP)  # the mission will wait for its first answer
    with listener() as heard:
        inject = injector(heard)
        assert inject(1, 'slow').message == 'there is no mission in flight'
        for uav in (2, 3):
            fleet.start_agent(uav)
        world.wait_for('mission .* starts')
        answers = [inject(uav, kind) for uav, kind in ((1, 'slow'), (2, 'gone'), (3, 'silent'))]
        wrong = [inject(4, 'slow'), inject(1, 'dead')]
    held.send(signal.SIGCONT)
    assert world.wait_for_exit() == 0
    assert all(answer.success for answer in answers)
    assert [answer.message for answer in wrong] == [
        'uav is 4: must be from 1 to 3',
        "fault is 'dead': must be one of gone, silent, slow",
    ]
    recorded = from_jsonl(fleet.log(SEED))
    assert {(fault.uav, fault.fault) for fault in recorded.faults} == {
        (uav, kind) for uav, kind in zip((2, 3, 1), FAULT_KINDS, strict=True)
    }
    assert flown_with(scenario, recorded) == fleet.log(SEED)
