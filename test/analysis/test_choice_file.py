"""The files that keep a choice: what they hold, and what is none of them."""

from collections.abc import Callable
import csv
from dataclasses import replace
import json
from pathlib import Path
from typing import Any

import pytest
from tiny_world import tiny
from uav_collect.analysis.choice import Choice
from uav_collect.analysis.choice_file import CHOICE_CSV, CHOICE_JSON, keep_choice, read_choice
from uav_collect.analysis.choosing import candidates_for, choose
from uav_collect.analysis.statistics import MEASURES
from uav_collect.errors import StoreError
from uav_collect.scenario.load import fingerprint
from uav_collect.scenario.site import build_site

Change = Callable[[dict[str, Any]], object]


@pytest.fixture(scope='module')
def choice() -> Choice:
    scenario = tiny()
    return choose(build_site(scenario), candidates_for(scenario)[0], n_missions=3)


def test_a_choice_is_read_back_as_it_was(choice: Choice, tmp_path: Path) -> None:
    keep_choice(choice, tmp_path / 'run')
    assert read_choice(tmp_path / 'run') == choice
    assert str(read_choice(tmp_path / 'run')) == str(choice)


def test_what_the_trials_of_each_candidate_took_stands_in_the_table(choice: Choice) -> None:
    tried = replace(choice.tried[0], computing_s=1.26)
    rows = str(replace(choice, tried=(tried, *choice.tried[1:]))).splitlines()
    assert [row.split()[-2] for row in rows[2:4]] == ['CPU', '1.3']
    assert all(it.computing_s is not None and it.computing_s > 0.0 for it in choice.tried)


def test_a_choice_of_before_has_no_such_column_filled(choice: Choice, tmp_path: Path) -> None:
    keep_choice(choice, tmp_path)
    values = json.loads((tmp_path / CHOICE_JSON).read_text())
    for it in values['tried']:
        del it['computing_s']
    (tmp_path / CHOICE_JSON).write_text(json.dumps(values))
    read = read_choice(tmp_path)
    assert read is not None
    assert [it.computing_s for it in read.tried] == [None, None]


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


def with_tried(**changed: object) -> Change:
    """The values with the first candidate changed."""
    return lambda values: {**values, 'tried': [{**values['tried'][0], **changed}]}


def with_mean(mean: object) -> Change:
    """The values with another mean of the first candidate."""
    estimate = {'mean': mean, 'low': 1.0, 'high': 1.0, 'median': 1.0}
    return with_tried(estimates={measure.key: estimate for measure in MEASURES})


@pytest.mark.parametrize(
    ('change', 'wrong'),
    [
        (lambda values: {}, "format must be 'uav_collect choice of a policy'"),
        (lambda values: [], 'format must be'),
        (lambda values: {**values, 'format': 'another'}, 'format must be'),
        (lambda values: {**values, 'tried': []}, 'tried is empty'),
        (lambda values: {**values, 'tried': 3}, 'tried is 3: must be a list'),
        (lambda values: {**values, 'tried': ['sweep']}, 'policy is missing'),
        (lambda values: {**values, 'tried': [{'policy': 'sweep'}]}, 'version is missing'),
        (lambda values: {**values, 'lead': 'far'}, 'mean is missing'),
        (
            lambda values: {**values, 'n_missions': '3'},
            "n_missions is '3': must be a whole",
        ),
        (lambda values: {**values, 'is_compiled': 1}, 'is_compiled is 1: must be true or false'),
        (
            lambda values: {**values, 'scenario': 'a\x1b[2J'},
            'scenario is .*: must be a printable text',
        ),
        (
            lambda values: {name: it for name, it in values.items() if name != 'first_seed'},
            'first_seed is missing',
        ),
        (with_tried(version=None), 'version is empty: must be a printable text'),
        (with_tried(estimates={}), 'efficiency_kbit_per_j is missing'),
        (with_mean('much'), "mean is 'much': must be a number"),
        (with_tried(computing_s='long'), "computing_s is 'long': must be a number"),
        (with_mean(float('nan')), 'mean is nan: must be finite'),
    ],
)
def test_what_is_no_choice_is_said_in_a_line(
    change: Change, wrong: str, choice: Choice, tmp_path: Path
) -> None:
    keep_choice(choice, tmp_path)
    file = tmp_path / CHOICE_JSON
    file.write_text(json.dumps(change(json.loads(file.read_text()))))
    with pytest.raises(StoreError, match=f'{file}: is no choice of a policy: {wrong}') as error:
        read_choice(tmp_path)
    assert len(str(error.value).splitlines()) == 1


def test_a_folder_without_a_choice_has_none(tmp_path: Path) -> None:
    assert read_choice(tmp_path) is None
    assert read_choice(tmp_path / 'nowhere') is None


@pytest.mark.parametrize('content', [b'{"format": ', b'\xff', b'[' * 100_000, b' ' * (1 << 21)])
def test_a_damaged_file_is_no_choice(content: bytes, tmp_path: Path) -> None:
    (tmp_path / CHOICE_JSON).write_bytes(content)
    with pytest.raises(StoreError, match=r'choice\.json: is no choice of a policy: '):
        read_choice(tmp_path)
