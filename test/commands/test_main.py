"""What all commands have in common: help, misuse, and a stdout that fails."""

import os
from pathlib import Path
import subprocess
import sys

from processes import complaints, completed
import pytest
from uav_collect.__main__ import main, SUMMARIES


def run(*arguments: str, **options: object) -> subprocess.CompletedProcess[str]:
    return completed(
        *(sys.executable, '-m', 'uav_collect', *arguments),
        status=None,
        cwd=Path(__file__).parents[2],
        env={key: value for key, value in os.environ.items() if key != 'PYTHONUNBUFFERED'},
        **options,
    )


def test_help_lists_the_commands_without_loading_them() -> None:
    program = (
        'import sys; from uav_collect.__main__ import main\n'
        'try: main(["--help"])\n'
        'except SystemExit: pass\n'
        'heavy = {"numpy", "numba", "rich", "yaml", "rclpy"} & set(sys.modules)\n'
        'assert not heavy, heavy'
    )
    done = completed(sys.executable, '-c', program, cwd=Path(__file__).parents[2])
    assert all(f'  {name} ' in done.stdout for name in SUMMARIES)


@pytest.mark.parametrize('command', ['', *SUMMARIES])
def test_each_command_has_help_of_80_columns(
    command: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv('COLUMNS', '80')
    with pytest.raises(SystemExit) as raised:
        main([*filter(None, [command]), '--help'])
    assert raised.value.code == 0
    said = capsys.readouterr().out
    assert said.startswith(f'usage: python -m uav_collect {command}')
    assert [line for line in said.splitlines() if len(line) > 80] == []


@pytest.mark.parametrize('typed', ['uav-collect', '/opt/venv/bin/uav-collect', 'uav-collect.exe'])
def test_help_names_the_command_by_which_it_was_asked(
    typed: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr('sys.argv', [typed])
    with pytest.raises(SystemExit):
        main(['list', '--nonsense'])
    assert capsys.readouterr().err.endswith('(see uav-collect list --help)\n')


@pytest.mark.parametrize('arguments', [[], ['fly'], ['--speed']])
def test_no_or_an_unknown_command_is_a_misuse(
    arguments: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as raised:
        main(arguments)
    assert raised.value.code == 2
    assert capsys.readouterr().err.startswith('error: ')


def test_a_full_disk_under_stdout_is_said_in_one_line() -> None:
    with Path('/dev/full').open('w') as full:
        done = run('doctor', stdout=full)
    assert done.returncode == 2
    assert complaints(done.stderr) == ['error: No space left on device']


def test_a_reader_that_leaves_causes_no_traceback() -> None:
    reading, writing = os.pipe()
    os.close(reading)
    done = run('doctor', stdout=writing)
    os.close(writing)
    assert done.returncode != 0
    assert complaints(done.stderr) == []
