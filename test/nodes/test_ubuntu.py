"""A fleet with the packages of Ubuntu 24.04's apt leaves the bytes that it always left.

`make test-ubuntu` lays the packages out, builds the messages with them, and runs this.
"""

from collections.abc import Iterator
from dataclasses import replace
import hashlib
import os
from pathlib import Path
import re
import shutil
import sys

from fleets import Fleet
from golden_logs import cases
from packages import without
from processes import Processes
import pytest
from uav_collect.config.packages import PACKAGES as PYTHON_PACKAGES
from uav_collect.recording.bag_reader import read_missions
from uav_collect.scenario.load import load

PACKAGES = os.environ.get('UAV_COLLECT_UBUNTU', '')
pytestmark = [
    pytest.mark.ros,
    pytest.mark.skipif(not PACKAGES, reason='needs the packages of apt: run "make test-ubuntu"'),
]

ROOT = Path(__file__).parents[2]
CASE = 'lillgrund-2-paper_10x10_n2_aqmix-exact'  # listed sensors, a learned policy


@pytest.fixture
def ubuntu(monkeypatch: pytest.MonkeyPatch) -> None:
    """Processes that are started find the packages of apt before any others."""
    paths = [PACKAGES, *filter(None, os.environ.get('PYTHONPATH', '').split(os.pathsep))]
    monkeypatch.setenv('PYTHONPATH', os.pathsep.join(paths))


@pytest.fixture
def on_board(ubuntu: None, ros_domain: int, tmp_path: Path) -> Iterator[Processes]:
    """Starts processes that find no other packages at all: neither pip's nor those for people."""
    others = {it.module for it in PYTHON_PACKAGES.values()} - {'numpy', 'yaml'}
    (tmp_path / 'on_board').mkdir()
    environment = without(tmp_path / 'on_board', [*others, 'pydantic', 'safetensors'], {})
    started = Processes(tmp_path / 'on_board', {**environment, 'ROS_DOMAIN_ID': str(ros_domain)})
    yield started
    started.close()


def test_the_doctor_sees_the_versions_of_apt_and_lets_missions_fly(
    ubuntu: None, processes: Processes
) -> None:
    doctor = processes.run('doctor', sys.executable, '-m', 'uav_collect', 'doctor')
    assert doctor.wait_for_exit() == 0, doctor.output
    found = dict(re.findall(r'^(\S+) +(.*)$', doctor.output, re.MULTILINE))
    pins = re.findall(r'^(\w+)==(\S+)', (ROOT / 'requirements/ubuntu_24_04.txt').read_text(), re.M)
    assert {name: found[name] for name, _ in pins} == dict(pins)
    assert found['messages'].startswith(str(Path(PACKAGES).parent))


def test_a_mission_with_the_versions_of_apt_leaves_the_bytes_that_it_always_left(
    ubuntu: None, processes: Processes, on_board: Processes, tmp_path: Path
) -> None:
    [case] = [case for case in cases() if str(case) == CASE]
    scenario, seed = load(case.scenario), case.mission_seed
    assert scenario.n_uavs == case.n_uavs
    fleet = Fleet(processes=on_board, scenario=scenario, folder=tmp_path / 'run')
    recorder = replace(fleet, processes=processes).start_recorder(stop_after_missions=1)
    fleet.start_agents(case.policy, case.bandwidth)
    world = fleet.start_world(seed=seed)
    assert (world.wait_for_exit(), recorder.wait_for_exit()) == (0, 0)
    log = fleet.log(seed)
    assert hashlib.sha256(log).hexdigest() == case.sha256
    assert [mission.log.to_jsonl() for mission in read_missions(fleet.bag)] == [log]
    run = shutil.copytree(fleet.folder, tmp_path / 'report')
    report = processes.run('report', sys.executable, '-m', 'uav_collect', 'report', str(run))
    report.wait_for(f'picture: {run}')
    assert report.wait_for_exit() == 0
