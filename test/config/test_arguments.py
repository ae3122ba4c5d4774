"""Misuse is one line that people can read, of commands and of nodes alike."""

import pytest
from uav_collect.config.arguments import error_lines, Parser


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
    first, second = error_lines(f'one\n{"two" * 1000}').splitlines()
    assert first == 'error: one'
    assert second.startswith('error: twotwo')
    assert len(second) < 1020
