"""Misuse is one line that people can read, of commands and of nodes alike."""

import pytest
from uav_collect.config.arguments import error_lines, Parser
from uav_collect.errors import BagError, ConfigError, reason_of


@pytest.mark.parametrize(
    ('argument', 'said'),
    [
        ('--speed', 'error: unrecognized arguments: --speed (see fly --help)\n'),
        ('a\nb\x1b', 'error: unrecognized arguments: a b\\x1b (see fly --help)\n'),
        ('', 'error: unrecognized arguments: (see fly --help)\n'),
    ],
)
def test_a_wrong_argument_ends_the_program_with_one_line(
    argument: str, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        Parser(prog='fly').parse_args([argument])
    assert ended.value.code == 2
    assert capsys.readouterr() == ('', said)


def test_each_problem_has_a_line_that_is_not_too_long() -> None:
    first, second = error_lines(ConfigError('one', 'two' * 1000)).splitlines()
    assert first == 'error: one'
    assert second.startswith('error: twotwo')
    assert len(second) < 1020


@pytest.mark.parametrize(
    'error',
    [
        BagError('a\nb.mcap: is no bag'),
        ConfigError('a\nb.mcap: is no bag'),
        OSError(1, 'is no bag', 'a\nb.mcap'),
    ],
)
def test_a_newline_in_a_name_does_not_break_the_line(error: Exception) -> None:
    assert error_lines(error) == 'error: a\\nb.mcap: is no bag\n'


def test_an_error_that_says_nothing_is_called_by_its_kind() -> None:
    assert reason_of(MemoryError()) == 'MemoryError'
    assert error_lines(OSError()) == 'error: OSError\n'
