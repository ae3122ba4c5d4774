"""A learner behind a bad channel: what it learns from is whole and right, or dropped."""

import json
import os
from pathlib import Path
import re
import signal
import sys

from episodes import single_threaded_torch
from processes import Processes
import pytest
from reports import same

torch = single_threaded_torch()
pytest.importorskip('rclpy')
from trainings import (
    fleet_of,
    in_process,
    NEVER,
    replayed,
    SCENARIO,
    start_fleet,
    start_trainer,
    TRAINED_S,
)
from uav_collect.training.progress import Budget

pytestmark = [pytest.mark.ros, pytest.mark.long]

HELPERS = Path(__file__).parents[1] / 'helpers'
N_MISSIONS = int(os.environ.get('UAV_COLLECT_RELAYED', '40'))
WHOLE_SHARE = 0.25  # of the missions arrive whole, about; each has some ten decisions
SEED = 100


@pytest.mark.nightly
def test_no_mission_is_wrong_that_a_channel_has_thinned_doubled_and_mixed(
    processes: Processes, tmp_path: Path
) -> None:
    relay = [sys.executable, str(HELPERS / 'lossy_relay_node.py')]
    channel = processes.run('relay', *relay, str(SCENARIO.n_uavs), '1')
    channel.wait_for('relaying')
    n_decisions = int(N_MISSIONS * WHOLE_SHARE * 10)
    n_kept, folder = 2 * n_decisions + 1000, tmp_path / 'run'
    learner = start_trainer(
        processes, folder, worlds='[b]', decisions=n_decisions, publish_every_updates=NEVER,
        replay_decisions=n_kept,
    )  # fmt: skip
    world = start_fleet(fleet_of(processes, tmp_path, 'a'), seed=SEED)
    assert learner.wait_for_exit(TRAINED_S) == 0
    world.kill()
    channel.send(signal.SIGINT)
    assert channel.wait_for_exit() == 0
    done = json.loads(channel.output.splitlines()[-1])
    episodes, _ = replayed(folder, **{'replay.decisions': n_kept})
    seeds = [one.mission_seed for one in episodes]
    expected, _ = in_process(range(SEED, max(seeds) + 1), Budget(decisions=1))
    for one in episodes:
        assert same(one, expected[one.mission_seed - SEED]) == []
    assert len({*seeds}) == len(seeds)
    n_flown = max(seeds) + 1 - SEED
    assert len(seeds) < n_flown
    assert min(done['dropped'], done['doubled'], done['held']) > n_decisions / 10
    assert not re.search(r'\d (?:refused|by the failsafe|foreign)', learner.output)
