"""Python packages that are missing or too old: one line each, with how to get them."""

from pathlib import Path

from packages import run, without
from processes import complaints
import pytest
from uav_collect.config.packages import messages_remedy

NUMPY = 'numpy is missing: apt install python3-numpy, or pip install "numpy>=1.26"'
YAML = (
    'PyYAML is 5.4.1: must be 6.0 or newer: apt install python3-yaml, or pip install "PyYAML>=6.0"'
)
ROSBAGS = 'rosbags is missing: pip install "rosbags>=0.11.9"'


def executable(name: str) -> tuple[str, str]:
    return (
        '-c',
        f'from uav_collect.nodes.executables import {name} as main; raise SystemExit(main())',
    )


@pytest.mark.parametrize(
    'program',
    [
        executable('world_sim'),
        executable('uav_agent'),
        executable('recorder'),
        executable('trainer'),
        ('-m', 'uav_collect', 'evaluate'),
        ('-m', 'uav_collect', 'mission', '--help'),
    ],
    ids=lambda program: program[-1][:60],
)
def test_what_is_missing_or_too_old_is_said_in_one_line_each(
    program: tuple[str, ...], tmp_path: Path
) -> None:
    done = run(without(tmp_path, ['numpy'], {'PyYAML': '5.4.1'}), *program)
    assert (done.returncode, done.stdout) == (2, '')
    assert complaints(done.stderr) == [f'error: {NUMPY}', f'error: {YAML}']


def test_only_who_needs_a_package_asks_for_it(tmp_path: Path) -> None:
    environment = without(tmp_path, ['rosbags', 'rclpy'], {})
    recorder = run(environment, *executable('recorder'))
    assert (recorder.returncode, complaints(recorder.stderr)) == (2, [f'error: {ROSBAGS}'])
    agent = run(environment, *executable('uav_agent'))
    assert agent.returncode == 2
    assert 'error: rclpy is missing: source a ROS 2 Jazzy' in agent.stderr
    assert run(environment, '-m', 'uav_collect', 'evaluate', '--help').returncode == 0


def test_what_studies_take_is_said_without_what_they_learn_by(tmp_path: Path) -> None:
    environment = without(tmp_path, ['torch'], {})
    asked = ('-m', 'uav_collect', 'figures', '--scale', 'laptop', '--only', 'range')
    done = run(environment, *asked, '--output', str(tmp_path / 'runs'), '--dry-run')
    assert (done.returncode, complaints(done.stderr)) == (0, [])
    assert ' of training' in done.stdout
    refused = run(environment, *asked, '--output', str(tmp_path / 'runs'))
    assert refused.returncode == 2
    assert complaints(refused.stderr)[-1].startswith('error: figures needs torch')


def test_a_package_that_is_loaded_late_is_asked_for_in_one_line(tmp_path: Path) -> None:
    environment = without(tmp_path, ['cvxpy'], {})
    asked = ('evaluate', '--missions', '1', '--policy', 'sweep', '--bandwidth', 'cvxpy')
    done = run({**environment, 'UAV_COLLECT_KERNELS': 'interpreted'}, '-m', 'uav_collect', *asked)
    assert done.returncode == 2
    assert done.stderr.splitlines()[-1] == 'error: cvxpy is missing: pip install cvxpy'
    assert 'Traceback' not in done.stderr


@pytest.mark.parametrize(
    ('package', 'built', 'words'),
    [
        ('repository/uav_collect', '', 'run "make setup" in {0}/repository'),
        (
            'repository/uav_collect',
            'repository/install/uav_collect_msgs',
            'source {0}/repository/i',
        ),
        (
            'ws/src/fleet/uav_collect',
            '',
            '--base-paths src src/fleet/msg_defs" in {0}/ws, or copy',
        ),
        ('ws/src/fleet/uav_collect', 'ws/install/uav_collect_msgs', 'source {0}/ws/install/setup'),
        (
            'ws/src/fleet/uav_collect',
            'ws/install/share/uav_collect_msgs',
            'source {0}/ws/install/',
        ),
        (
            'ws/install/uav_collect/lib/python3.12/site-packages/uav_collect',
            '',
            'in {0}/ws, or copy',
        ),
        ('ws/install/lib/python3.12/site-packages/uav_collect', '', 'in {0}/ws, or copy'),
    ],
)
def test_the_way_to_the_messages_fits_how_the_package_was_built(
    package: str, built: str, words: str, tmp_path: Path
) -> None:
    (tmp_path / built).mkdir(parents=True, exist_ok=True)
    assert words.format(tmp_path) in messages_remedy(tmp_path / package)


def test_the_way_to_the_messages_is_a_command_for_who_installed_by_pip(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr('sys.prefix', str(tmp_path))
    package = tmp_path / 'lib' / 'python3.12' / 'site-packages' / 'uav_collect'
    assert messages_remedy(package) == 'run "uav-collect messages"'


def test_messages_that_are_sourced_and_do_not_load_are_to_be_built_anew(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / 'install' / 'uav_collect_msgs').mkdir(parents=True)
    monkeypatch.setenv('AMENT_PREFIX_PATH', f'/opt/ros/jazzy:{tmp_path}/install/uav_collect_msgs')
    assert messages_remedy(tmp_path / 'uav_collect') == f'build {tmp_path} anew'
