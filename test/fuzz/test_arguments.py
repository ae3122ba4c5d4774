"""Arguments of commands: whatever is typed beside a scenario or file that is not there.

The command does nothing and says why. So nothing is flown or learned by chance.
"""

import argparse
from functools import cache
from pathlib import Path
import tempfile
from typing import Any

from fuzzing import check_outcome, fuzzed, run_command
from hypothesis import strategies as st
import pytest
from uav_collect.__main__ import command_named, SUMMARIES

# What no command can do anything with, and so does nothing else.
IMPOSSIBLE = {
    'field': ['no_such_list.csv'],
    'mission': ['--scenario=no.yaml'],
    'evaluate': ['--scenario=no.yaml'],
    'train': ['--scenario=no.yaml'],
    'tune': ['--scenario=no.yaml', '--vary=target.trace=0.5,0.7'],
    'refine': ['--scenario=no.yaml'],
    'train-fleet': ['--scenario=no.yaml'],
    'size': ['--scenario=no.yaml'],
    'bound': ['--scenario=no.yaml'],
    'figures': ['--only=no-such-study'],
    'curves': ['no_such_run'],
    'report': ['no_such_log'],
    'export': ['no_such_log', '--to=csv'],
    'verify': ['no_such_bag'],
}
TAKE_NOTHING = {'list', 'messages', 'doctor'}
TEXTS = st.text(st.characters(exclude_categories=['Cs'], exclude_characters='\x00/'), max_size=12)
NUMBERS = st.one_of(
    st.integers(-3, 100).map(str),
    st.integers(-(10**40), 10**40).map(str),
    st.floats().map(str),
    st.sampled_from(['1e400', '-0', '0x10', '1_000', '٣', '1' * 5000, '1/0', 'nan', '-inf']),
)
PATHS = st.sampled_from(
    [
        '/',
        '/dev/full',
        '/dev/null',
        '/proc/self/mem',
        '.',
        '..',
        '',
        '~',
        'Größe/ä.json',
        'a/b/c.csv',
    ]
)
KEYS = st.sampled_from(
    ['area.altitude_m', 'area', 'fleet.uavs.0.speed_mps', 'a.b.c', '.', '..', '', 'name', '0.0']
)
ASSIGNMENTS = st.builds('{}={}'.format, KEYS, st.one_of(NUMBERS, TEXTS, st.just('[[[[{')))
WORDS = st.one_of(
    TEXTS, NUMBERS, PATHS, ASSIGNMENTS,
    st.sampled_from(['sweep', 'hert', 'os:system', 'a:b', ':', 'x.safetensors', 'exact', 'ray']),
    st.sampled_from(['--', '-h0', '--seed', '--nonsense', '[/b]', '\x1b[31mred', 'x' * 100_000]),
)  # fmt: skip


@cache
def options(command: str) -> tuple[argparse.Action, ...]:
    """What a command takes, but for what makes it show something and end."""
    parser = argparse.ArgumentParser()
    command_named(command).add_arguments(parser)
    shown = ('--help', '--list')
    return tuple(
        it for it in parser._actions if it.option_strings[-1:] not in [[x] for x in shown]
    )


@st.composite
def arguments(draw: st.DrawFn, command: str) -> list[str]:
    """Some options of a command with some words after each, and what is impossible."""
    words: list[str] = []
    for option in draw(st.lists(st.sampled_from(options(command)), max_size=4)):
        values = draw(st.lists(WORDS, min_size=0 if option.nargs == 0 else 1, max_size=2))
        words += [*option.option_strings[:1], *values]
    place = draw(st.sampled_from([0, len(words)]))
    return [*words[:place], *IMPOSSIBLE[command], *words[place:]]


def test_every_command_that_takes_anything_is_tried() -> None:
    assert {*IMPOSSIBLE} == {*SUMMARIES} - TAKE_NOTHING


@pytest.mark.parametrize('command', IMPOSSIBLE)
def test_a_command_with_any_arguments_ends_in_a_line(
    command: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    with tempfile.TemporaryDirectory() as folder:
        inner = Path(folder) / 'inner'  # nothing is above it, either
        inner.mkdir()
        monkeypatch.chdir(inner)
        _try_arguments(command, Path(folder))


def _try_arguments(command: str, folder: Path) -> None:
    before = [*folder.rglob('*')]

    @fuzzed(share=1.0 / len(IMPOSSIBLE), words=arguments(command))
    def try_arguments(words: list[str]) -> None:
        outcome: Any = run_command(command, *words)
        assert outcome.status == 2, outcome
        check_outcome(outcome)
        assert [*folder.rglob('*')] == before

    try_arguments()
