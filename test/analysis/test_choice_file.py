"""The files that keep a choice: what they hold, and what is none of them."""

import csv
import json
from pathlib import Path

import pytest
from tiny_world import tiny
from uav_collect.analysis.choice import Choice
from uav_collect.analysis.choice_file import CHOICE_CSV, CHOICE_JSON, keep_choice, read_choice
from uav_collect.analysis.choosing import candidates_for, choose
from uav_collect.scenario.load import fingerprint
from uav_collect.scenario.site import build_site


@pytest.fixture(scope='module')
def choice() -> Choice:
    scenario = tiny()
    return choose(build_site(scenario), candidates_for(scenario)[0], n_missions=3)


def test_a_choice_is_read_back_as_it_was(choice: Choice, tmp_path: Path) -> None:
    keep_choice(choice, tmp_path / 'run')
    assert read_choice(tmp_path / 'run') == choice


def test_the_json_says_who_flies_and_why(choice: Choice, tmp_path: Path) -> None:
    keep_choice(choice, tmp_path)
    values = json.loads((tmp_path / CHOICE_JSON).read_text())
    assert (values['policy'], values['why']) == (choice.policy, choice.why)
    assert (values['scenario'], values['fingerprint']) == ('tiny', fingerprint(tiny()))
    assert (values['n_missions'], values['n_planned']) == (3, 3)


def test_the_csv_has_a_row_for_each_candidate(choice: Choice, tmp_path: Path) -> None:
    keep_choice(choice, tmp_path)
    rows = [*csv.DictReader((tmp_path / CHOICE_CSV).read_text().splitlines())]
    assert [row['policy'] for row in rows] == ['sweep', 'hert']
    assert [row['policy'] for row in rows if row['is_best'] == '1'] == [choice.policy]
    for row, tried in zip(rows, choice.tried, strict=True):
        efficiency = tried.estimates['efficiency_kbit_per_j']
        assert float(row['efficiency_kbit_per_j']) == efficiency.mean
        assert float(row['efficiency_kbit_per_j_low']) == efficiency.low
        assert float(row['completion_s']) == tried.estimates['completion_s'].mean


@pytest.mark.parametrize(
    'change',
    [
        lambda values: {},
        lambda values: [],
        lambda values: {**values, 'format': 'another'},
        lambda values: {**values, 'tried': []},
        lambda values: {**values, 'tried': [{'policy': 'sweep'}]},
        lambda values: {**values, 'lead': 'far'},
        lambda values: {name: it for name, it in values.items() if name != 'first_seed'},
    ],
)
def test_what_is_no_choice_is_none(change: object, choice: Choice, tmp_path: Path) -> None:
    keep_choice(choice, tmp_path)
    file = tmp_path / CHOICE_JSON
    file.write_text(json.dumps(change(json.loads(file.read_text()))))  # type: ignore[operator]
    assert read_choice(tmp_path) is None


def test_a_folder_without_a_choice_has_none(tmp_path: Path) -> None:
    assert read_choice(tmp_path) is None
    assert read_choice(tmp_path / 'nowhere') is None
    (tmp_path / CHOICE_JSON).write_bytes(b'{"format": ')
    assert read_choice(tmp_path) is None
