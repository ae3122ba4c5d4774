"""Messages for who has installed by pip: what the command refuses, and what a node finds by."""

from pathlib import Path
import shutil

from processes import complaints, completed
import pytest
from uav_collect.__main__ import main
from uav_collect.commands import messages

ROOT = Path(__file__).parents[2]


def refusal(capsys: pytest.CaptureFixture[str]) -> str:
    assert main(['messages']) == 2
    [line] = complaints(capsys.readouterr().err)
    return line


def test_in_a_checkout_messages_are_left_to_its_own_set_up(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert refusal(capsys).startswith('error: this builds messages where pip has installed it: ')


def test_a_path_that_ros_cannot_build_below_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    prefix = tmp_path / 'Größe'
    module = prefix / 'lib' / 'python3.12' / 'site-packages' / 'uav_collect' / 'commands' / 'x.py'
    monkeypatch.setattr('sys.prefix', str(prefix))
    monkeypatch.setattr(messages, '__file__', str(module))
    assert refusal(capsys).startswith(f'error: {prefix}: ROS cannot build there: its path must be')


@pytest.mark.parametrize('before', ['', '/opt/ros/jazzy'])
def test_a_node_that_pip_has_installed_finds_messages_with_nothing_sourced(
    before: str, tmp_path: Path
) -> None:
    node = tmp_path / 'lib' / 'uav_collect' / 'control'
    python = tmp_path / 'bin' / 'python3'
    for path in (node, python):
        path.parent.mkdir(parents=True)
    shutil.copy(ROOT / 'tools' / 'start_node.sh', node)
    python.write_text('#!/bin/sh\necho "$AMENT_PREFIX_PATH"\n')
    python.chmod(0o755)
    environment = {'PATH': '/usr/bin:/bin', 'AMENT_PREFIX_PATH': before}
    shown = completed('sh', node, env=environment)
    assert shown.stdout.strip() == ':'.join(filter(None, (str(tmp_path), before)))
