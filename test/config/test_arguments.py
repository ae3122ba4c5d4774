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


@pytest.mark.parametrize(
    ('line', 'path', 'speeds'),
    [
        ('--speed 10 PATH', 'PATH', [10.0]),
        ('--speed 10 15 PATH', 'PATH', [10.0, 15.0]),
        ('PATH --speed 10 15', 'PATH', [10.0, 15.0]),
        ('--speed 10 --title x PATH', 'PATH', [10.0]),
        ('--speed 10 15 -- 20', '20', [10.0, 15.0]),
    ],
)
def test_an_option_of_several_values_ends_where_a_word_can_be_none(
    line: str, path: str, speeds: list[float]
) -> None:
    parser = Parser(prog='fly')
    parser.add_argument('path')
    parser.add_argument('--speed', type=float, nargs='+')
    parser.add_argument('--title')
    found = parser.parse_args(line.split())
    assert (found.path, found.speed) == (path, speeds)


def test_a_first_value_that_can_be_none_is_named(capsys: pytest.CaptureFixture[str]) -> None:
    parser = Parser(prog='fly')
    parser.add_argument('path')
    parser.add_argument('--speed', type=float, nargs='+')
    with pytest.raises(SystemExit):
        parser.parse_args(['--speed', 'fast', 'PATH'])
    assert "invalid float value: 'fast'" in capsys.readouterr().err


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
