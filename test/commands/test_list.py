"""What `list` shows: all that can be named, with a line each."""

from pathlib import Path
import re

import pytest
from uav_collect.__main__ import main
from uav_collect.config.installed import shared_folders
from uav_collect.config.layers import names_in, titles_in
from uav_collect.scenario.load import scenario_names
from uav_collect.uav.heuristics import Heuristic
from uav_collect.uav.policy import shipped_policies


def test_it_shows_all_there_is_with_a_line_each_of_80_columns(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(['list']) == 0
    printed = capsys.readouterr().out
    assert [line for line in printed.splitlines() if len(line) > 80] == []
    parts = re.split(r'^(\w.*):\n', printed, flags=re.MULTILINE)
    tables = dict(zip(parts[1::2], parts[2::2], strict=True))
    rules = ('best', 'strong', *(heuristic.label for heuristic in Heuristic))
    own = ('lookahead:RULE', 'module:name', 'FILE.safetensors')
    names = {
        'scenarios (--scenario)': scenario_names(),
        'policies (--policy)': (*rules, *shipped_policies(), *own),
        'presets of trainings (--preset)': names_in(shared_folders('training')),
        'scales of the figures (--scale)': names_in(shared_folders('studies')),
    }
    assert tables.keys() == names.keys()
    for kind, table in tables.items():
        shown = dict(re.findall(r'^  (\S+) +(\S.*)$', table, re.MULTILINE))
        assert {*shown} == {*names[kind]}
        assert table.count('\n') == len(shown)
        assert '...' not in table  # nothing is cut off


def test_a_policy_says_what_it_learned_on(capsys: pytest.CaptureFixture[str]) -> None:
    main(['list'])
    learned = r'paper_10x10_n4_aqmix +aqmix on paper_10x10, 4 UAVs, [\d,]+ decisions\n'
    assert re.search(learned, capsys.readouterr().out)


@pytest.mark.parametrize(
    ('text', 'title'),
    [
        ('# A farm of 2.7 km: 48 turbines.\n# More.\na: 1\n', 'A farm of 2.7 km'),
        ('# What learns (the\n# best).\n', 'What learns'),
        ('# One that goes\n# on; and on\n', 'One that goes on'),
        ('a: 1  # not a title\n', ''),
        ('', ''),
    ],
)
def test_a_title_is_how_the_first_comment_begins(text: str, title: str, tmp_path: Path) -> None:
    (tmp_path / 'one.yaml').write_text(text)
    assert titles_in([tmp_path]) == {'one': title}
