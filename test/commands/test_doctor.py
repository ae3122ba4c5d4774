"""The command doctor."""

from pathlib import Path

from packages import run, without
import pytest
from uav_collect.__main__ import main
from uav_collect.commands import doctor
from uav_collect.config.packages import PACKAGES


def problems(environment: dict[str, str]) -> dict[str, str]:
    healthy = {'HOME': str(Path.home()), 'ROS_DISTRO': 'jazzy'}
    findings = doctor.examine({**healthy, **environment})
    return {finding.topic: finding.problem for finding in findings if finding.problem}


@pytest.mark.parametrize(
    ('environment', 'topic'),
    [
        ({'ROS_DOMAIN_ID': '233'}, 'domain'),
        ({'ROS_DOMAIN_ID': 'one'}, 'domain'),
        ({'ROS_AUTOMATIC_DISCOVERY_RANGE': 'OFF'}, 'discovery'),
        ({'ROS_AUTOMATIC_DISCOVERY_RANGE': 'near'}, 'discovery'),
        ({'ROS_DISTRO': 'humble'}, 'ROS distribution'),
        ({'HOME': ''}, 'ROS log'),
        ({'UAV_COLLECT_KEY_FILE': '/no/such/key'}, 'key'),
    ],
)
def test_the_doctor_names_what_keeps_a_mission_from_flying(
    environment: dict[str, str], topic: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(doctor, '_imported', lambda name, *_: doctor.Finding(topic=name, found=''))
    monkeypatch.setattr(doctor, 'is_there', lambda _: True)  # of ROS, whether it is sourced or not
    assert set(problems({})) == set()
    assert set(problems(environment)) == {topic}


def test_the_doctor_says_why_an_import_fails() -> None:
    found = doctor._imported('thing', 'import a_module_that_is_not_there', 'install it')
    assert "No module named 'a_module_that_is_not_there'" in found.problem
    assert 'install it' in found.problem


def test_the_doctor_survives_a_library_that_kills_the_process() -> None:
    found = doctor._imported('thing', 'import os; os.abort()', 'mend it')
    assert 'exit status' in found.problem


@pytest.mark.parametrize(('broken', 'status'), [('', 0), ('it is broken', 1)])
def test_the_doctors_exit_status_tells_health(
    broken: str, status: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    finding = doctor.Finding(topic='thing', found='seen', problem=broken)
    monkeypatch.setattr(doctor, 'examine', lambda *_, **__: iter([finding]))
    assert main(['doctor']) == status
    shown = capsys.readouterr().out
    assert ('problem: thing: it is broken' in shown) == bool(broken)


def test_the_doctor_examines_a_machine_without_packages(tmp_path: Path) -> None:
    missing = ('yaml', 'rich', 'numba', 'rosbags', 'rclpy', 'nav_msgs', 'uav_collect_msgs')
    environment = without(tmp_path, missing, {'numpy': '1.24.0'})
    done = run(environment, '-m', 'uav_collect', 'doctor')
    assert (done.returncode, done.stderr) == (1, '')
    for words in (
        'numba             missing; only for compiled kernels',
        'problem: numpy: numpy is 1.24.0: must be 1.26 or newer: apt install python3-numpy, or ',
        'problem: PyYAML: PyYAML is missing: apt install python3-yaml, or pip install "PyYAML>=',
        'problem: rich: rich is missing: apt install python3-rich',
        'problem: rosbags: rosbags is missing: pip install "rosbags>=0.11.9"',
        'missing: source a ROS 2 Jazzy',
        'problem: messages: ',
    ):
        assert words in done.stdout


@pytest.mark.parametrize('package', ['nav_msgs', 'visualization_msgs'])
def test_the_doctor_names_the_packages_that_a_distribution_lacks(
    package: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(doctor, 'is_there', lambda name: name != package)
    found = doctor._ros_packages()
    [rest] = found.problem.split(f'{package} missing: ')[1:]
    assert rest == f'apt install ros-jazzy-{package.replace("_", "-")}, or run "make setup"'


def test_on_board_the_doctor_asks_only_for_what_world_and_agents_need(tmp_path: Path) -> None:
    for missing, named in ((('rich', 'matplotlib', 'rosbags'), set()), (('numpy',), {'numpy'})):
        folder = tmp_path / missing[0]
        folder.mkdir()
        environment = without(folder, missing, {})
        shown = run(environment, '-m', 'uav_collect', 'doctor', '--on-board').stdout
        problems_of = {
            line.split()[1].rstrip(':') for line in shown.splitlines() if 'problem' in line
        }
        assert problems_of & {*PACKAGES} == named
