"""What agents report to learners is what the same decisions look like in one process."""

from pathlib import Path
from typing import Any

from fleets import Fleet, listener, parameters, Pilots, scenario_of
from node_starts import refusal
import numpy as np
from processes import Processes
import pytest
from uav_collect.scenario.load import fingerprint
from uav_collect.scenario.model import Scenario
from uav_collect.uav.observation import Layout, Observer

pytest.importorskip('rclpy')
pytest.importorskip('uav_collect_msgs')

from uav_collect.nodes import topics

pytestmark = pytest.mark.ros

SEED = 2
LAYOUTS = [(Layout.PAPER, Layout.EGOCENTRIC), (Layout.RELATIVE, Layout.RELATIVE)]  # by UAV


def in_process(scenario: Scenario, layouts: tuple[Layout, ...]) -> list[list[tuple[Any, ...]]]:
    """For each UAV: event, decision, observation, legal actions and action of every decision."""
    pilots = Pilots(scenario, SEED, 'sweep')
    briefing = pilots.simulation.briefing
    taken: list[list[tuple[Any, ...]]] = [[], []]
    while (event := pilots.simulation.next_event()) is not None:
        decision = pilots.decide(event)
        agent, layout = pilots.agents[event.uav], layouts[event.uav]
        out = Observer(layout, briefing, event.uav).observe(agent.belief, event.view, agent.legal)
        encoded = np.asarray(out, dtype=np.float32).tolist()
        legal = [bool(flag) for flag in agent.legal]
        taken[event.uav].append((event.index, event.decision, encoded, legal, decision.action))
        pilots.simulation.start(event, decision)
    return taken


@pytest.mark.parametrize('layouts', LAYOUTS)
def test_every_decision_is_reported_to_learners_as_it_would_be_in_process(
    layouts: tuple[Layout, ...], processes: Processes, tmp_path: Path
) -> None:
    scenario = scenario_of()
    expected = in_process(scenario, layouts)
    fleet = Fleet(processes=processes, scenario=scenario, folder=tmp_path / 'run')
    own = [topics.uav_topics(uav).transition for uav in (1, 2)]
    with listener(*own) as listening:
        for uav, layout in enumerate(layouts, start=1):
            fleet.start_agent(uav, observation_layout=layout.name.lower())
        fleet.start_world(seed=SEED)
        heard = [listening.heard[topic.name] for topic in own]
        listening.wait_until(lambda: [*map(len, heard)] == [*map(len, expected)])
    for uav, (messages, decisions) in enumerate(zip(heard, expected, strict=True), start=1):
        reported = [
            (each.event, each.decision, [*each.observation], [*each.legal], each.action)
            for each in messages
        ]
        assert reported == decisions
        assert {each.layout for each in messages} == {layouts[uav - 1].label}
        assert {each.uav for each in messages} == {uav}
        assert {each.scenario_fingerprint for each in messages} == {fingerprint(scenario)}
        assert len({each.mission_id for each in messages}) == 1


def test_without_a_layout_nothing_is_reported(processes: Processes, tmp_path: Path) -> None:
    fleet = Fleet(processes=processes, scenario=scenario_of(1), folder=tmp_path / 'run')
    with listener(topics.MISSION, topics.uav_topics(1).transition) as listening:
        fleet.start_agents()
        fleet.start_world()
        heard = listening.heard[topics.MISSION.name]
        listening.wait_until(lambda: len(heard) == 2)
        assert listening.heard[topics.uav_topics(1).transition.name] == []


def test_an_unknown_layout_is_refused_in_one_line(
    ros_domain: int, capsys: pytest.CaptureFixture[str]
) -> None:
    known = 'paper, egocentric, relative and module:Name'
    unknown = parameters(observation_layout='square')
    assert refusal('agent', ['--id', '1', *unknown], capsys) == [
        f"error: observation_layout 'square' is unknown; there are {known}"
    ]
