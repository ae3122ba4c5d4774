"""The command bound."""

import csv
import json
from pathlib import Path

from bounds import bound, plans
import numpy as np
import pytest
from uav_collect.__main__ import main
from uav_collect.planning import bound as planned
from uav_collect.scenario.load import load

pytestmark = pytest.mark.usefixtures('bound_cache')


FEW = ('--scenario', 'paper_8x8', '--missions', '6', '--seed', '5')


def test_the_command_writes_what_it_shows(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    files = tmp_path / 'bound.json', tmp_path / 'bound.csv'
    written = ['--json', str(files[0]), '--csv', str(files[1])]
    assert main(['bound', *FEW, '--bandwidth', 'equal', 'exact', *written]) == 0
    printed = capsys.readouterr().out
    for words in (
        'shortest plan',
        'thriftiest plan',
        'no flight beyond',
        'kbit/J',
        '% of the time',
    ):
        assert words in printed
    document = json.loads(files[0].read_text())
    assert [*document] == ['equal', 'exact']
    assert document['equal']['missions'] == document['equal']['missions_with_plans'] == 6
    with files[1].open(newline='') as lines:
        rows = list(csv.DictReader(lines))
    assert [int(row['mission_seed']) for row in rows] == [*range(5, 11)] * 2
    for allocator, some in (('equal', rows[:6]), ('exact', rows[6:])):
        for key in ('shortest_completion_s', 'thriftiest_energy_kj', 'limit_energy_kj'):
            mean = np.mean([float(row[key]) for row in some])
            assert document[allocator][key]['mean'] == pytest.approx(mean)
    found = bound(load('paper_8x8'), 5, 'equal')
    assert float(rows[0]['shortest_completion_s']) == plans(found)[0].completion_s


def test_more_rounds_find_no_worse_plans_on_average(tmp_path: Path) -> None:
    means = []
    for rounds in ('0', '300', '6000'):
        file = tmp_path / f'{rounds}.json'
        assert main(['bound', *FEW, '--rounds', rounds, '--json', str(file)]) == 0
        means.append(json.loads(file.read_text())['exact']['shortest_completion_s']['mean'])
    assert means[0] > means[1] >= means[2]


@pytest.mark.parametrize(('n_plans', 'n_missions'), [(7, 3), (1, 0)])
def test_ctrl_c_shows_and_writes_the_missions_that_are_planned(
    n_plans: int, n_missions: int, tmp_path: Path, capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    calls, whole = iter(range(100)), planned.bound_of

    def bound_some(*arguments: object) -> object:
        if next(calls) == n_plans:
            raise KeyboardInterrupt
        return whole(*arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(planned, 'bound_of', bound_some)
    document, table = tmp_path / 'bound.json', tmp_path / 'bound.csv'
    written = ['--json', str(document), '--csv', str(table)]
    assert main(['bound', *FEW, '--bandwidth', 'equal', 'exact', *written]) == 130
    printed = capsys.readouterr().out
    assert f'interrupted after {n_missions} of 6 missions' in printed
    assert document.exists() == table.exists() == bool(n_missions)
    if n_missions:
        assert f'{n_missions} missions from seed 5' in printed
        found = json.loads(document.read_text())
        assert [of['missions'] for of in found.values()] == [n_missions] * 2
        rows = [*csv.DictReader(table.read_text().splitlines())]
        assert [int(row['mission_seed']) for row in rows] == [*range(5, 5 + n_missions)] * 2


def test_the_command_says_where_there_is_no_plan(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / 'bound.csv'
    budget = ['--set', 'fleet.default.energy_budget_kj=8']
    assert main(['bound', *FEW, *budget, '--csv', str(file)]) == 0
    assert 'no plan within the energy budgets was found in 6 missions' in capsys.readouterr().out
    with file.open(newline='') as lines:
        rows = list(csv.DictReader(lines))
    assert {row['shortest_completion_s'] for row in rows} == {''}
    assert all(float(row['limit_energy_kj']) > 0 for row in rows)
