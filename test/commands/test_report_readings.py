"""What report says of single sensors: who read them when, and whose data were left."""

import csv
from pathlib import Path

import pytest
from tiny_world import fly_scripts, tiny
from uav_collect.__main__ import main
from uav_collect.recording.mission_log import from_jsonl
from uav_collect.uav.action_codes import FORWARD, HOVER, RIGHT


@pytest.fixture
def run_folder(tmp_path: Path) -> Path:
    """One UAV reads sensor S1, nobody S2 and S3."""
    scenario = tiny()
    log = fly_scripts(scenario, [RIGHT, HOVER, FORWARD], [])
    (tmp_path / 'mission.jsonl').write_bytes(log.to_jsonl())
    (tmp_path / 'scenario.yaml').write_text(scenario.to_yaml())
    return tmp_path


def test_report_shows_who_read_which_sensor_when_and_how_fast(
    run_folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(['report', str(run_folder), '--readings']) == 0
    [row] = [line for line in capsys.readouterr().out.splitlines() if line.split()[:1] == ['S1']]
    log = from_jsonl((run_folder / 'mission.jsonl').read_bytes())
    [hover] = log.events[log.events['action'] == HOVER]
    up_s, rate_bps = hover['time_s'] + hover['duration_s'], 1e6 / hover['duration_s']
    words = ['S1', '10.0', f'{up_s:.1f}', '1', '1.000', f'{rate_bps / 1e3:.1f}', '500.0']
    assert row.split() == words


def test_report_names_the_sensors_whose_data_were_left(
    run_folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(['report', str(run_folder)]) == 0
    assert 'warning: 0.75 Mbit of data were left behind, at S2, S3\n' in capsys.readouterr().out


def test_report_writes_readings_as_csv(run_folder: Path, tmp_path: Path) -> None:
    file = tmp_path / 'readings.csv'
    assert main(['report', str(run_folder), '--csv', str(file)]) == 0
    [row] = csv.DictReader(file.read_text().splitlines())
    assert (row['mission_seed'], row['sensor_id'], row['uav'], row['cell']) == (
        '0',
        'S1',
        '1',
        '1',
    )
    assert float(row['data_mbit']) == 1.0
    read_s = float(row['end_s']) - float(row['start_s'])
    assert float(row['rate_bps']) * read_s == pytest.approx(1e6)


def test_a_table_that_cannot_be_written_is_said_before_anything_is_drawn(
    run_folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(['report', str(run_folder), '--csv', str(run_folder)]) == 2
    shown = capsys.readouterr()
    assert shown.out == ''
    assert 'is a folder: must be a file' in shown.err
    assert not (run_folder / 'mission.png').exists()
