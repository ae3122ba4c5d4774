"""Faults injected in flight are in the log, which the same faults give again to the byte."""

from collections.abc import Callable
from pathlib import Path
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


def asker(heard: Listener, service: Any) -> Callable[..., Any]:  # noqa: ANN401 - a service
    """What asks the world, and gives its answer."""
    from uav_collect.nodes import topics
    from uav_collect_msgs.srv import InjectFault

    name = topics.INJECT_SERVICE if service is InjectFault else topics.CONTROL_SERVICE
    client = heard.node.create_client(service, name)
    heard.wait_until(client.service_is_ready)

    def ask(**values: object) -> Any:  # noqa: ANN401 - a message
        call = client.call_async(service.Request(**values))
        heard.wait_until(call.done)
        return call.result()

    return ask


def test_injected_faults_are_logged_and_give_the_same_mission_again(
    processes: Processes, tmp_path: Path
) -> None:
    from uav_collect_msgs.srv import ControlMission, InjectFault

    scenario = scenario_of(3, radio__loss_share=0.2, radio__delay_s=[2.0, 1.0])
    fleet = Fleet(processes=processes, scenario=scenario, folder=tmp_path / 'run')
    world = fleet.start_world(seed=SEED, missions=1)
    with listener() as heard:
        inject, control = asker(heard, InjectFault), asker(heard, ControlMission)
        assert inject(uav=1, fault='slow').message == 'there is no mission in flight'
        assert control(command=ControlMission.Request.PAUSE).success
        fleet.start_agents()
        world.wait_for('mission .* starts')
        for _ in range(3):
            assert control(command=ControlMission.Request.STEP).success
        fleet.wait_for_events(SEED, 2)
        faults = (1, 'slow'), (2, 'gone'), (3, 'silent')
        answers = [inject(uav=uav, fault=kind) for uav, kind in faults]
        wrong = [inject(uav=4, fault='slow'), inject(uav=1, fault='dead')]
        assert control(command=ControlMission.Request.RESUME).success
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
