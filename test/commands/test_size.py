"""The command size: what it says, writes and refuses."""

import csv
from dataclasses import replace
import json
import math
from pathlib import Path

import pytest
from tiny_world import tiny, uav
from uav_collect.__main__ import main
from uav_collect.analysis import sizing
from uav_collect.scenario.load import fingerprint
from uav_collect.scenario.model import BatteryConfig, FleetConfig

EVERYWHERE = [(50.0 * cell % 200 + 25.0, cell // 4 * 50.0 + 25.0, 1.0) for cell in range(16)]
SCENARIO = tiny(
    uav(5.0), uav(10.0), sensors=EVERYWHERE, name='patch', demand__data_mbit=[1.0, 20.0]
)
MISSIONS = 12


@pytest.fixture
def field(tmp_path: Path) -> str:
    """A file of a scenario of 16 cells, with a sensor in each."""
    path = tmp_path / 'patch.yaml'
    path.write_text(SCENARIO.to_yaml())
    return str(path)


def size(field: str, *arguments: str) -> int:
    return main(['size', '--scenario', field, '--missions', str(MISSIONS), *arguments])


def test_it_ends_with_the_batteries_that_fleets_need(
    field: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert size(field, '--uavs', '2', '1', '--complete', '90') == 0
    shown, said = capsys.readouterr()
    assert '2 fleets x about 9 batteries (one of them ample) x 12 missions = about 216 m' in said
    assert ' Wh of energy_margin_kj) / 0.8\n' in shown
    *_, of_two, of_one, advice, flown = shown.strip().splitlines()
    # Wilson's intervals of 11 and 12 of 12, and the least n with n / (n + 1.96^2) >= 0.9
    sentences = (
        'all data in 11 of 12 missions (at least 64.6 %): 2 x ',
        'all data in 12 of 12 missions (at least 75.7 %): 1 x ',
    )
    assert (of_two.startswith(sentences[0]), of_one.startswith(sentences[1])) == (True, True)
    assert advice == 'too few missions to show 90 %: fly --missions 35 or more'
    batteries = [float(it.split(' x ')[1].removesuffix(' Wh')) for it in (of_two, of_one)]
    assert batteries == sorted(batteries)  # two UAVs need less each
    assert 'missions flown in' in flown
    assert all(len(line) <= 80 for line in shown.splitlines())
    assert '80 % of each battery are usable; charges at 22.2 V' in shown


def test_files_and_words_say_the_same(
    field: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    table, document, picture = (tmp_path / name for name in ('s.csv', 's.json', 's.png'))
    wanted = ['--csv', str(table), '--json', str(document), '--picture', str(picture)]
    assert size(field, '--uavs', '2', '--usable', '75', '--volt', '20', *wanted) == 0
    written = json.loads(document.read_text())
    assert (written['scenario'], written['seed'], written['wanted_share']) == ('patch', 0, 0.99)
    assert written['fingerprint'] == fingerprint(SCENARIO)
    needed_wh = written['found'][0]['battery_wh']
    assert f'2 x {needed_wh:g} Wh' in capsys.readouterr().out
    with table.open(newline='') as file:
        rows = list(csv.DictReader(file))
    assert [row['uav'] for row in rows] == ['1', '2'] * (len(rows) // 2)
    assert {row['missions'] for row in rows} == {str(MISSIONS)}
    ample, best = rows[0], next(row for row in rows if row['battery_wh'] == str(needed_wh))
    assert ample['battery_wh'] == ''
    assert float(best['complete_share']) >= 0.99
    # 1 kJ of margin, and three quarters of the battery usable
    numbers = [cell for key, cell in best.items() if key.endswith(('_kj', '_max', '_p50'))]
    assert all(len(it.replace('.', '')) <= 7 for it in numbers)  # no digits but what is known
    need_wh = (float(ample['energy_kj_max']) + 1.0) / 3.6 / 0.75
    assert float(ample['battery_wh_max']) == pytest.approx(need_wh, rel=1e-5)
    assert float(ample['battery_mah_max']) == pytest.approx(need_wh / 20 * 1e3, rel=1e-5)
    assert float(best['budget_kj']) == pytest.approx(needed_wh * 3.6 * 0.75, rel=1e-5)
    assert picture.read_bytes().startswith(b'\x89PNG')
    assert len(written['trials']) == len(rows)


def test_batteries_that_are_named_are_flown_and_no_others(
    field: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    document = tmp_path / 's.json'
    batteries = ['--battery-wh', '40', '0.001', '3', '--json', str(document)]
    assert size(field, '--uavs', '1', *batteries) == 0
    trials = json.loads(document.read_text())['trials']
    assert [trial['battery_wh'] for trial in trials] == [None, 0.001, 3.0, 40.0]
    assert [trial['complete_share'] for trial in trials] == [1.0, 0.0, 0.0, 1.0]
    assert trials[1]['energy_kj_max'] is None  # it did not take off
    shown, said = capsys.readouterr()
    assert '1 fleet x 4 batteries (one of them ample) x 12 missions = 48 missions; ' in said
    assert 'stays' in shown
    assert 'all data in 12 of 12 missions (at least 75.7 %): 1 x 40 Wh' in shown


def test_a_share_is_said_of_missions_that_are_enough_to_show_it(
    field: str, capsys: pytest.CaptureFixture[str]
) -> None:
    wanted = ['--uavs', '1', '--battery-wh', '40', '--complete', '75']
    assert size(field, *wanted) == 0
    assert 'with 75 % of missions complete: 1 x 40 Wh\n' in capsys.readouterr().out


def test_batteries_that_are_too_small_are_said_with_one_to_try(
    field: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert size(field, '--uavs', '1', '--battery-wh', '3') == 0
    said = ' '.join(capsys.readouterr().out.split())
    assert '1 UAV: 3 Wh are too little for 99 % of missions: 100.00 % with all' in said
    try_wh = float(said.rpartition('try ')[2].split()[0])
    assert 3.0 < try_wh < math.inf


def with_batteries(field: str, *batteries: BatteryConfig) -> str:
    path = Path(field)
    uavs = zip(SCENARIO.uavs, batteries, strict=True)
    fleet = FleetConfig(uavs=tuple(replace(uav, battery=it) for uav, it in uavs))
    path.write_text(replace(SCENARIO, fleet=fleet).to_yaml())
    return field


def test_batteries_are_those_of_the_scenario_unless_others_are_asked_for(
    field: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    of_m300 = BatteryConfig(usable_share=0.7, nominal_v=46.2)
    one = with_batteries(field, of_m300, of_m300), '--uavs', '1', '--battery-wh', '40', '--csv'
    assert size(*one, str(tmp_path / 'own.csv')) == 0
    assert '70 % of each battery are usable; charges at 46.2 V' in capsys.readouterr().out
    row = next(csv.DictReader((tmp_path / 'own.csv').read_text().splitlines()))
    need_wh = (float(row['energy_kj_max']) + 1.0) / 3.6 / 0.7
    assert float(row['battery_mah_max']) == pytest.approx(need_wh / 46.2 * 1e3, rel=1e-5)
    assert size(*one, str(tmp_path / 'asked.csv'), '--usable', '90', '--volt', '20') == 0
    assert '90 % of each battery are usable; charges at 20 V' in capsys.readouterr().out


def test_a_scenario_of_several_batteries_is_asked_which_is_meant(
    field: str, capsys: pytest.CaptureFixture[str]
) -> None:
    mixed = with_batteries(field, BatteryConfig(nominal_v=22.4), BatteryConfig(nominal_v=46.2))
    assert size(mixed) == 2
    [line] = capsys.readouterr().err.splitlines()
    assert line.startswith('error: --volt: must be given, as all UAVs have the same battery here')
    assert line.endswith('those of the scenario have 22.4 and 46.2')


def test_ctrl_c_keeps_what_was_flown(
    field: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(sizing, '_AT_ONCE', 5)
    whole, calls = sizing.fly_for_metrics, iter(range(100))

    def fly_some(*arguments: object) -> object:
        if (
            next(calls) == 6
        ):  # after a look at a few, all with ample energy, and a part of a flight
            raise KeyboardInterrupt
        return whole(*arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(sizing, 'fly_for_metrics', fly_some)
    document = tmp_path / 's.json'
    assert size(field, '--json', str(document)) == 130
    shown = capsys.readouterr().out
    assert 'interrupted after 10 of 12 missions of a flight' in shown
    assert [trial['missions'] for trial in json.loads(document.read_text())['trials']][::2] == [
        12,
        10,
    ]


@pytest.mark.parametrize(
    ('arguments', 'words'),
    [
        (['--battery-wh', '0'], "'0' must be a number from 0.001 to 100000 Wh"),
        (['--battery-wh', 'x'], "'x' must be a number from 0.001 to 100000 Wh"),
        (['--complete', '101'], "'101' must be a number from 0.1 to 100 %"),
        (['--usable', 'nan'], "'nan' must be a number from 1 to 100 %"),
        (['--uavs', '0'], "'0' must be a whole number from 1 to 64"),
        (['--bandwidth', 'cvxpy'], 'exact'),
    ],
)
def test_what_cannot_be_meant_is_refused(
    arguments: list[str], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as refused:
        main(['size', *arguments])
    assert refused.value.code == 2
    assert words in capsys.readouterr().err


def test_a_policy_that_does_not_fit_is_refused_before_anything_flies(
    field: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert size(field, '--policy', 'paper_10x10_n2_qmix') == 2
    shown = capsys.readouterr()
    assert shown.out == ''
    assert 'paper_10x10_n2_qmix' in shown.err
