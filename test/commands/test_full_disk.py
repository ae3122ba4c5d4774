"""Commands on a disk that is full: what was found is shown, what was there stays."""

from argparse import Namespace
from functools import partial
from pathlib import Path
from typing import Any

from full_disk import no_file_beyond
import pytest
from tiny_world import tiny
from uav_collect.__main__ import main
from uav_collect.commands import mission, train_fleet

COMMANDS = {
    'evaluate': (('--policy', 'sweep', '--missions', '2'), 'sweep'),
    'size': (('--missions', '2', '--battery-wh', '50'), 'all data in'),
    'bound': (('--missions', '1', '--rounds', '0'), 'all demand known'),
}


@pytest.mark.parametrize('option', ['--json', '--csv'])
@pytest.mark.parametrize('command', COMMANDS)
def test_figures_that_no_disk_takes_are_shown_all_the_same(
    command: str, option: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scenario, kept = tmp_path / 'tiny.yaml', tmp_path / 'kept'
    scenario.write_text(tiny().to_yaml())
    kept.write_text('from before')
    options, figures = COMMANDS[command]
    words = [command, '--scenario', str(scenario), *options]
    with no_file_beyond(60):
        assert main([*words, option, str(kept)]) == 2
    shown = capsys.readouterr()
    assert shown.err.splitlines()[-1] == f'error: {kept}: File too large'
    assert figures in shown.out
    assert kept.read_text() == 'from before'
    assert {path.name for path in tmp_path.iterdir()} == {'tiny.yaml', 'kept'}
    assert main([*words, option, '/dev/full']) == 2
    shown = capsys.readouterr()
    assert shown.err.splitlines()[-1].startswith('error: /dev/full: No space left on device')
    assert figures in shown.out


@pytest.mark.parametrize(
    'begin',
    [
        partial(mission._fly, policy='sweep', why='', own={}),
        partial(train_fleet._start, said=Path(), allocator='exact', max_decisions=9),
    ],
    ids=['mission', 'train-fleet'],
)
def test_a_scenario_that_no_disk_takes_is_named_before_any_node_starts(
    begin: Any,  # noqa: ANN401
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    with no_file_beyond(60), pytest.raises(OSError, match='File too large') as refused:
        begin(fleet=None, folder=tmp_path, scenario=tiny(), arguments=Namespace())
    assert Path(refused.value.filename).name == 'scenario.yaml'
    assert [*tmp_path.iterdir()] == []
