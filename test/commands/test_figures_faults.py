"""What becomes of figures that cannot be drawn or written: the jobs go on, the status tells."""

from argparse import Namespace
from pathlib import Path

import pytest
from study_jobs import flights
from uav_collect.commands.figures import _Drawn
from uav_collect.commands.figures_plan import FiguresPlan
from uav_collect.limits import UNUSABLE


class Picture:
    table, others = b'table', {}

    def picture(self, kind: str) -> bytes:
        return kind.encode()


@pytest.fixture
def drawn(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> _Drawn:
    """A study called whole, and results.md, drawn and judged without any job."""
    whole = {'whole': None}
    plan = Namespace(
        scale=Namespace(name='tiny'),
        store=None,
        asked=('whole',),
        studies=whole,
        complete_studies=lambda: whole,
        jobs_of=lambda _: {},
    )
    studies = 'uav_collect.studies'
    monkeypatch.setattr(f'{studies}.pictures.draw.draw', lambda *_: Picture())
    monkeypatch.setattr(f'{studies}.claims.claims.judge', lambda *_: [])
    monkeypatch.setattr(f'{studies}.results_text.results_text', lambda *_: 'results')
    return _Drawn(Namespace(output=tmp_path, results=None), plan)  # type: ignore[arg-type]


def test_a_figure_that_cannot_be_written_is_tried_again_at_the_end(
    drawn: _Drawn, tmp_path: Path
) -> None:
    taken = tmp_path / 'tiny' / 'whole.png'
    taken.mkdir(parents=True)
    drawn.draw_whole()
    assert (tmp_path / 'tiny' / 'results.md').read_text() == 'results'
    assert drawn.finish() == UNUSABLE
    taken.rmdir()
    assert drawn.finish() == 0
    assert taken.read_bytes() == b'png'


@pytest.mark.parametrize(('n_missions', 'words'), [(1, '1 mission'), (2, '2 missions')])
def test_a_job_says_how_many_missions_it_flies(n_missions: int, words: str) -> None:
    plan = Namespace(jobs={'this': flights(n_missions=n_missions)})
    name = FiguresPlan.name_of(plan, 'this')  # type: ignore[arg-type]
    assert name.startswith(f'fly {words} by sweep, tiny, ')


def test_an_error_of_a_figure_is_said_while_jobs_run_and_raised_at_the_end(
    drawn: _Drawn, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr('uav_collect.studies.pictures.draw.draw', lambda *_: 1 / 0)
    drawn.draw_whole()
    assert 'whole cannot be drawn yet: division by zero' in capsys.readouterr().err
    with pytest.raises(ZeroDivisionError):
        drawn.finish()
