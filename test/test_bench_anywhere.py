"""The conditions that bench/anywhere.py flies, and what it says of them."""

from pathlib import Path

import pytest
from random_policies import header, saved
from small_courses import small_courses
from uav_collect.errors import ConfigError
from uav_collect.scenario.load import fingerprint, load
from uav_collect.uav.observation import Layout
from uav_collect.uav.operating_domain import OperatingDomain

from bench import anywhere

FILES = ('anywhere.yaml', 'anywhere_held_out.yaml')
TINY = """
rows:
  - {name: tiny, kind: area, set: {area.cells_per_side: 4}}
  - {name: another, kind: cell, set: {area.cells_per_side: 4, area.cell_size_m: 80.0}}
"""


@pytest.fixture
def tiny_file(tmp_path: Path) -> Path:
    path = tmp_path / 'tiny.yaml'
    path.write_text(TINY)
    return path


def rows(name: str, *list_folders: Path) -> list[anywhere.Row]:
    return [*anywhere.rows_of(anywhere.HERE / name, list_folders)]


def test_every_condition_is_a_scenario_of_its_own() -> None:
    prints = [fingerprint(row.scenario) for name in FILES for row in rows(name)]

    assert len({*prints}) == len(prints)
    assert len(rows('anywhere_held_out.yaml')) == 20


def test_a_row_without_its_list_is_left_out_and_named(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    without = rows('anywhere.yaml')
    said = capfd.readouterr().err
    (tmp_path / 'cook_farm.csv').write_text('sensor_id,x_m,y_m,data_mbit\na,0,0,1\nb,9,9,1\n')

    assert len(rows('anywhere.yaml', tmp_path)) == len(without) + 1 == 60
    assert 'row cook farm is left out: there is no cook_farm.csv' in said


def test_fleet_and_values_of_a_row_stand_over_those_of_its_scenario() -> None:
    found = {row.name: row.scenario for row in rows('anywhere.yaml')}

    assert [uav.speed_mps for uav in found['three UAVs'].uavs] == [5.0, 10.0, 8.0]
    assert found['paper 10x10 by four'].n_uavs == 4
    assert found['no radio'].radio.contact_range_m == 0.0
    assert found['paper 10x10'] == load('paper_10x10')


@pytest.mark.parametrize(
    ('text', 'problem'),
    [
        ('rows: [{name: a, kind: b}, {name: a, kind: c}]', 'two rows are called a'),
        ('rows: [{name: a, kind: b, set: {radio.range_m: 1}}]', 'row a: .*radio.range_m'),
        ('rows: [{name: a, kind: b, sets: {}}]', r'rows\.0\.sets is an unknown key'),
    ],
)
def test_a_wrong_row_is_named(tmp_path: Path, text: str, problem: str) -> None:
    path = tmp_path / 'wrong.yaml'
    path.write_text(text)

    with pytest.raises(ConfigError, match=problem):
        list(anywhere.rows_of(path, ()))


def test_the_table_says_how_each_policy_stands(
    tiny_file: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    table = tmp_path / 'table.csv'
    words = ['--conditions', str(tiny_file), '--missions', '3', '--plans', '1']

    assert anywhere.main([*words, '--policies', 'hert-equal', '--csv', str(table)]) == 0

    said = capfd.readouterr().out
    lines = [line.split(',')[0] for line in table.read_text().splitlines()]
    assert lines == ['condition', *['tiny'] * 3, *['another'] * 3]
    assert 'hert-equal: flew 2 of 2 rows, 6 missions' in said


def test_of_drawn_conditions_those_within_a_policys_domains_may_be_kept(tmp_path: Path) -> None:
    domains = (OperatingDomain(n_uavs=(2, 3)),)
    wide = {'cells_per_side_max': 64, 'n_uavs_max': 16, 'advice_bonus': 0.1}
    of = header(Layout.RELATIVE, side=1, n_uavs=1, **wide, domains=domains)
    within = str(saved(tmp_path, 'of_two_or_three', of))
    drawn = [*anywhere.drawn_rows('anywhere', 12)]
    kept = [*anywhere.drawn_rows('anywhere', 3, within)]
    assert [it.name for it in kept] == [it.name for it in drawn if it.scenario.n_uavs in (2, 3)][
        :3
    ]


def test_conditions_may_be_drawn_as_courses_are(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    drawn = [*anywhere.drawn_rows('anywhere', 3)]
    assert [it.name for it in drawn] == [it.name for it in anywhere.drawn_rows('anywhere', 3)]
    assert len({fingerprint(it.scenario) for it in drawn}) == 3
    small = tmp_path / 'small.yaml'
    small.write_text(small_courses().distribution.to_yaml())
    words = ['--courses', str(small), '--missions', '3', '--plans', '0', '--policies']
    assert anywhere.main([*words, '--drawn', '2']) == 0
    said = capsys.readouterr().out
    assert 'small-0: ' in said
    assert 'small-1: ' in said
    assert anywhere.main(['--courses', 'nowhere']) == 2


def test_an_interruption_keeps_the_rows_that_are_done(
    tiny_file: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    fly_row = anywhere.fly_row

    def interrupted(row: anywhere.Row, *others: object) -> anywhere.Result:
        if row.name == 'another':
            raise KeyboardInterrupt
        return fly_row(row, *others)

    monkeypatch.setattr(anywhere, 'fly_row', interrupted)
    words = ['--conditions', str(tiny_file), '--missions', '2', '--plans', '0']

    assert anywhere.main([*words, '--policies']) == 130

    said = capfd.readouterr()
    assert 'tiny' in said.out
    assert 'interrupted after 1 of 2 rows' in said.err


def test_a_pattern_that_no_row_fits_is_refused(
    tiny_file: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    assert anywhere.main(['--conditions', str(tiny_file), '--rows', 'nowhere']) == 2
    assert '--rows nowhere: there is no such row' in capfd.readouterr().err


def test_what_keeps_only_drawn_conditions_is_refused_without_any(
    capsys: pytest.CaptureFixture[str],
) -> None:
    with pytest.raises(SystemExit):
        anywhere.arguments_of(['--within', 'anywhere'])
    assert '--within: must come with --courses' in capsys.readouterr().err
