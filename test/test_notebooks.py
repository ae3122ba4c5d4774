"""The notebooks in examples/notebooks run from their first cell to their last."""

import os
from pathlib import Path
import re
import sys

from documents import ROOT
from processes import completed
import pytest

NOTEBOOKS = ROOT / 'examples' / 'notebooks'
SHORT = (
    '--decisions 300 --override rollout.missions_at_once=4 rollout.max_decisions_per_cell=0.2'
    ' replay.missions_per_batch=4 replay.decisions=2000 network.hidden_size=8'
    ' mixer.embedding_size=4 mixer.hypernetwork_size=8 validation.missions=2'
)
# Files that each leaves, by its name.
LEFT = {
    'compare_policies': (),
    'plan_a_field': ('loggers.yaml', 'loggers.png', 'flight.png'),
    'train_and_see_it_fly': (
        'five_minutes/policy.safetensors',
        'mission_7.png',
        'film_mission_7.html',
    ),
}


def test_every_notebook_is_run() -> None:
    assert {path.stem for path in NOTEBOOKS.iterdir()} == {*LEFT}


@pytest.mark.parametrize('name', LEFT)
def test_a_notebook_runs_to_its_end(name: str, tmp_path: Path) -> None:
    few = {'UAV_COLLECT_NOTEBOOK_MISSIONS': '2', 'UAV_COLLECT_NOTEBOOK_TRAINING': SHORT}
    few |= {'PYTHONPATH': str(ROOT), 'UAV_COLLECT_KERNELS': 'interpreted'}
    notebook = NOTEBOOKS / f'{name}.py'
    done = completed(sys.executable, notebook, cwd=tmp_path, env=os.environ | few)
    assert '2 missions from seed 0' in done.stdout
    folder = tmp_path / 'runs' / 'notebooks'
    assert [file for file in LEFT[name] if not (folder / file).is_file()] == []
    assert {it.name for it in tmp_path.iterdir()} <= {'runs'}


@pytest.mark.parametrize('name', LEFT)
def test_a_notebook_opens_with_a_title_and_what_it_is_about(name: str) -> None:
    text = (NOTEBOOKS / f'{name}.py').read_text()
    cells = re.findall(r'^# %%( \[markdown\])?\n', text, re.MULTILINE)
    assert cells[0] == ' [markdown]'
    assert re.search(r'^# %% \[markdown\]\n# # .+\n#\n# [A-Z]', text, re.MULTILINE)
