"""The command train on courses, in this process: what it leaves, and how it is gone on with."""

import csv
from pathlib import Path

import pytest
from tiny_world import tiny, uav
from train_command import columns
from uav_collect.__main__ import main
from uav_collect.uav.policy_file import load_policy

pytest.importorskip('torch', reason='training needs torch')

COURSES = """extends: anywhere
panel: two.yaml
area: {cells_per_side: [3, 4]}
fleet: {n_uavs: [1, 2], ample: [1.0, 1.5]}
sensors: {sparse_mean: [1.0, 2.0]}
"""
PANEL = """conditions:
- {name: plain, scenario: field.yaml}
- {name: one, scenario: field.yaml, uavs: 1, set: {demand.cell_share: 0.5}}
"""
PRESET = """extends: anywhere
network: {hidden_size: 8}
mixer: {embedding_size: 4, hypernetwork_size: 4}
rollout: {missions_at_once: 2, decisions_per_update: 40}
replay: {decisions: 2000, missions_per_batch: 4, rows_per_batch: 40}
courses: {at_once: 2, updates_each: 4}
validation: {missions: 1, every_updates: 5}
"""


@pytest.fixture
def run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Path:
    """The folder of a run on small courses that has had its time; what it said is to be read."""
    fleet = uav(5.0, energy_budget_kj=20.0), uav(10.0, energy_budget_kj=10.0)
    (tmp_path / 'field.yaml').write_text(tiny(*fleet, name='field').to_yaml())
    for name, text in (('small', COURSES), ('two', PANEL), ('quick', PRESET)):
        (tmp_path / f'{name}.yaml').write_text(text)
    given = ['--courses', str(tmp_path / 'small.yaml'), '--preset', str(tmp_path / 'quick.yaml')]
    folder = tmp_path / 'runs' / 'small'
    assert main(['train', *given, '--decisions', '800', '--output', str(folder)]) == 0
    del capsys  # taken, so that it has what was said by then
    return folder


def test_a_run_on_courses_stands_alone_and_is_gone_on_with(
    run: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ('small', 'two', 'quick', 'field'):
        (run.parents[1] / f'{name}.yaml').unlink()
    panel = columns(run / 'panel.csv')
    n_validations = len(columns(run / 'validation.csv')['n_decisions'])
    assert panel['condition'] == ['1', '2'] * n_validations
    assert (run / 'curve.png').read_bytes().startswith(b'\x89PNG')
    said = capsys.readouterr()
    assert 'in the panel: x' in said.out
    assert 'of the sweep best, worst x' in said.err
    assert load_policy(run / 'policy.safetensors').header.scenario == 'small'
    assert main(['train', '--resume', str(run), '--decisions', '1200']) == 0
    assert int(columns(run / 'panel.csv')['n_decisions'][-1]) >= 1200


def test_a_run_whose_panel_was_changed_is_refused(
    run: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    panel = run / 'panel.yaml'
    panel.write_text(panel.read_text().replace('name: plain', 'name: other'))
    capsys.readouterr()
    assert main(['train', '--resume', str(run), '--decisions', '1200']) == 2
    assert 'courses.yaml: its fingerprint, with that of panel.yaml, is' in capsys.readouterr().err


def test_the_measure_of_the_panel_is_drawn_over_decisions(run: Path, tmp_path: Path) -> None:
    table = tmp_path / 'curve.csv'
    given = ['curves', str(run), '--measure', 'sweep_ratio', '--csv', str(table)]
    assert main([*given, '--output', str(tmp_path / 'curve.png')]) == 0
    with table.open(newline='') as file:
        last = [*csv.DictReader(file)][-1]
    ratios = [*map(float, columns(run / 'panel.csv')['sweep_ratio'][-2:])]
    assert float(last['mean_sweep_ratio']) == pytest.approx(sum(ratios) / 2)
