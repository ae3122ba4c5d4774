"""Missions leave the bytes that they left before: scenarios, fleets, policies and allocators."""

from pathlib import Path
import re
import shutil

from golden_logs import Case, cases, digest
import pytest
from uav_collect.__main__ import main

GOLDEN = Path(__file__).parents[1] / 'golden'


@pytest.mark.parametrize('case', [*cases()], ids=str)
def test_a_mission_leaves_the_bytes_that_it_always_left(case: Case) -> None:
    n_events, sha256 = digest(case)
    assert (n_events, sha256) == (case.n_events, case.sha256)


@pytest.mark.parametrize('inside', ['.', 'mission_5.jsonl', 'bag'])
def test_a_run_folder_of_the_first_release_can_be_reported(
    inside: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = shutil.copytree(GOLDEN / 'run_folder', tmp_path / 'run')
    assert main(['report', str(folder / inside)]) == 0
    report = capsys.readouterr().out
    assert 'paper_8x8, mission seed 5: sweep, exact bandwidth' in report
    assert re.search(r'energy +50\.84 kJ', report)
    assert re.search(r'completion time +197\.5 s', report)
