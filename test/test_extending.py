"""Every block of docs/extending.md works, and each example is one short file."""

import ast
from pathlib import Path
import re

from episodes import single_threaded_torch, small
import pytest
from tiny_world import tiny, uav
from uav_collect.missions.rollout import fly
from uav_collect.scenario.site import build_site

torch = single_threaded_torch()
from uav_collect.learning.trainer import Trainer
from uav_collect.training.progress import Budget

ROOT = Path(__file__).parent.parent
PAGE = (ROOT / 'docs' / 'extending.md').read_text()
BLOCKS = re.findall(r'```python\n(.*?)```', PAGE, re.DOTALL)
OTHER_LEARNERS = (ROOT / 'docs' / 'rl.md').read_text()  # links the examples that it is about
EXAMPLES = [
    path
    for path in sorted((ROOT / 'examples').glob('*.py'))
    if f'examples/{path.name})' not in OTHER_LEARNERS
]
SCENARIO = tiny(uav(5.0, energy_budget_kj=25.0), uav(10.0, energy_budget_kj=12.0))


def test_all_that_the_page_shows_flies_or_learns_together(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / 'shown.py').write_text('\n\n'.join(BLOCKS))
    monkeypatch.syspath_prepend(tmp_path)
    [log] = fly(build_site(SCENARIO), [1], 'shown:nearest')
    assert len(log.events) > 3
    settings = {
        'network__kind': 'shown:Small',
        'mixer__kind': 'shown:Weighted',
        'observation': 'shown:Clock',
        'reward__goal': 'shown:quick',
    }
    trainer = Trainer([SCENARIO], small('strong', **settings), 'shown:Cautious', 0)
    progress = [*trainer.run(Budget(decisions=300))]
    assert trainer.n_updates > 3
    assert progress[-1].validation is not None
    code = trainer.policy().header.code.split()
    names = ['Clock', 'quick', 'Small', 'Weighted', 'Cautious']
    assert [it.split('@')[0] for it in code] == [f'shown:{name}' for name in names]


@pytest.mark.parametrize('path', EXAMPLES, ids=lambda path: path.stem)
def test_an_example_is_one_short_file_that_the_page_links(path: Path) -> None:
    text = path.read_text()
    if path.stem != 'minimal_agent':  # needs the messages alone; docs/how_to/nodes.md links it
        assert f'examples/{path.name})' in PAGE
        assert len(text.splitlines()) <= 80
    imported = {
        alias.name.split('.')[0]
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.Import)
        for alias in node.names
    }
    assert 'uav_collect' not in imported
