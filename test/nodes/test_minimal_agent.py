"""An agent that knows nothing of this package flies a UAV by what the messages say."""

from pathlib import Path
import sys

import pytest

for needed in ('rclpy', 'uav_collect_msgs'):
    pytest.importorskip(needed)

from fleets import Fleet, listener, scenario_of
from processes import Processes
from steered_world import SteeredWorld
from uav_collect.analysis.metrics import mission_metrics
from uav_collect.nodes import topics
from uav_collect.recording.mission_log import read
from uav_collect_msgs.msg import Command, Mission, UavFigures

pytestmark = pytest.mark.ros

EXAMPLE = Path(__file__).parents[2] / 'examples' / 'minimal_agent.py'
SEED = 2
MOST_LINES = 85  # without blank ones, imports and comments: it is to be read at a glance


def test_it_is_short_and_imports_nothing_of_the_package() -> None:
    lines = [line.strip() for line in EXAMPLE.read_text().splitlines()]
    assert not any('uav_collect.' in line or 'uav_collect ' in line for line in lines)
    code = [it for it in lines if it and not it.startswith(('#', 'import ', 'from '))]
    assert len(code) <= MOST_LINES


def test_it_flies_a_uav_beside_one_of_ours(processes: Processes, tmp_path: Path) -> None:
    field = scenario_of(2, area__rows=8, area__columns=11, demand__known_empty='sensors')
    fleet = Fleet(processes=processes, scenario=field, folder=tmp_path / 'run')
    world = fleet.start_world(seed=SEED, missions=2)
    example = processes.run('example', sys.executable, str(EXAMPLE), '1')
    fleet.start_agent(2)
    assert world.wait_for_exit() == 0
    for seed in (SEED, SEED + 1):
        flown = mission_metrics(read(fleet.log_file(seed)))
        assert flown.collected_bit == pytest.approx(flown.total_bit)
        assert not flown.failsafe_used
        assert flown.uavs[0].n_decisions > 10
    assert 'refused' not in world.output
    assert example.is_running


def test_it_learns_why_a_command_is_refused(processes: Processes, tmp_path: Path) -> None:
    fleet = Fleet(processes=processes, scenario=scenario_of(1), folder=tmp_path / 'run')
    own = topics.uav_topics(1)
    with listener(topics.MISSION, own.refusal, own.observation) as listening:
        steered = SteeredWorld(listening.node, listening.wait_until)
        world = fleet.start_world(seed=SEED)
        steered.pause()
        processes.run('example', sys.executable, str(EXAMPLE), '1')
        stranger = topics.publisher(listening.node, own.command)
        observations = listening.heard[own.observation.name]
        steered.step()
        listening.wait_until(lambda: bool(observations))
        stranger.publish(
            Command(
                agent_instance='stranger',
                mission_id=observations[0].mission_id,
                decision=10**6,
                action=Command.HOVER,
            )
        )
        refusals = listening.heard[own.refusal.name]
        listening.wait_until(lambda: bool(refusals))
        steered.resume()
        missions = listening.heard[topics.MISSION.name]
        listening.wait_until(lambda: bool(missions) and missions[-1].phase == Mission.ENDED)
        assert world.wait_for_exit() == 0
    refusal = refusals[0]
    assert (refusal.agent_instance, refusal.what) == ('stranger', 'command')
    assert refusal.decision == 10**6
    assert refusal.reason == 'it is not from the agent that flies this UAV'
    assert missions[-1].uavs[0].outcome == UavFigures.CHOSEN
