"""The command export: which files it writes, which it leaves alone, what it refuses."""

from collections.abc import Sequence
import json
from pathlib import Path
from typing import Any

from handed_on import on_earth, SCRIPTS
import pytest
from tiny_world import fly_scripts, tiny
from uav_collect.__main__ import main
from uav_collect.handover import mission_items
from uav_collect.limits import HANDOVER_KINDS
from uav_collect.scenario.model import Scenario

STEM = 'tiny_seed_0'
FILES = {
    f'{STEM}_uav_1.plan', f'{STEM}_uav_2.plan', f'{STEM}_uav_1.waypoints',
    f'{STEM}_uav_2.waypoints', f'{STEM}.kml', f'{STEM}.geojson', f'{STEM}_states.csv',
}  # fmt: skip


def write_run(
    folder: Path, scenario: Scenario, scripts: Sequence[Sequence[int]] = SCRIPTS
) -> Path:
    folder.mkdir()
    log = fly_scripts(scenario, *scripts)
    (folder / 'mission_0.jsonl').write_bytes(log.to_jsonl())
    (folder / 'scenario.yaml').write_text(scenario.to_yaml())
    return folder


@pytest.fixture
def run_folder(tmp_path: Path) -> Path:
    return write_run(tmp_path / 'run', on_earth())


@pytest.fixture
def nowhere(tmp_path: Path) -> Path:
    """A run of a scenario that does not say where on Earth it lies."""
    return write_run(tmp_path / 'nowhere', tiny())


def items_of(plan: Path) -> list[dict[str, Any]]:
    items: list[dict[str, Any]] = json.loads(plan.read_text())['mission']['items']
    return items


def exported(folder: Path) -> set[str]:
    return {file.name for file in folder.iterdir()} - {'mission_0.jsonl', 'scenario.yaml'}


@pytest.mark.parametrize('name', ['', 'mission_0.jsonl'])
def test_export_writes_all_kinds_beside_a_recording(
    run_folder: Path, name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(['export', str(run_folder / name), '--to', *HANDOVER_KINDS]) == 0
    assert exported(run_folder) == FILES
    shown = capsys.readouterr()
    assert {Path(line).name for line in shown.out.splitlines()} == FILES
    assert shown.err == (
        f'warning: {STEM}: UAVs 1, 2 take off and land at one place and fly at one height, 100 m: '
        'let them start one after the other\n'
    )


def test_export_replaces_no_file_unless_it_is_forced(
    run_folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mine = run_folder / f'{STEM}.kml'
    mine.write_text('mine')
    command = ['export', str(run_folder), '--to', 'geojson', 'kml']
    assert main(command) == 2
    error = f'error: {mine}: is there: must be given --force to replace it\n'
    assert capsys.readouterr().err == error
    assert exported(run_folder) == {mine.name}
    assert mine.read_text() == 'mine'
    assert main([*command, '--force']) == 0
    assert mine.read_text().startswith('<?xml')


def test_export_writes_nothing_where_one_file_cannot_be_written(
    run_folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (run_folder / f'{STEM}.geojson').mkdir()
    assert main(['export', str(run_folder), '--to', 'kml', 'geojson', '--force']) == 2
    assert 'is a folder: must be a file' in capsys.readouterr().err
    assert exported(run_folder) == {f'{STEM}.geojson'}


def test_export_without_a_place_on_earth_says_what_to_add(
    nowhere: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(['export', str(nowhere), '--to', 'csv', 'plan']) == 2
    [line] = capsys.readouterr().err.splitlines()
    assert 'tiny: area.reference is missing' in line
    assert '--reference LAT LON' in line
    assert exported(nowhere) == set()
    assert main(['export', str(nowhere), '--to', 'csv']) == 0
    assert exported(nowhere) == {f'{STEM}_states.csv'}


def test_export_takes_the_corner_of_an_area_that_lies_nowhere(nowhere: Path) -> None:
    command = ['export', str(nowhere), '--to', 'plan', '--reference', '-33.5', '18.25']
    assert main(command) == 0
    take_off, *_ = items_of(nowhere / f'{STEM}_uav_1.plan')
    lat_deg, lon_deg = take_off['params'][4:6]
    assert (lat_deg, lon_deg) == pytest.approx((-33.5, 18.25), abs=0.001)
    assert lat_deg > -33.5


def test_export_of_a_plan_flies_what_bound_finds(
    tmp_path: Path, bound_cache: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / 'tiny.yaml'
    file.write_text(on_earth().to_yaml())
    folder = tmp_path / 'new' / 'folder'
    command = ['export', '--plan', 'shortest', '--scenario', str(file), '--seed', '3']
    assert main([*command, '--to', 'plan', '--output', str(folder)]) == 0
    names = [Path(line).name for line in capsys.readouterr().out.splitlines()]
    assert names == [f'tiny_seed_3_shortest_uav_{uav}.plan' for uav in (1, 2)]
    stays = [
        item
        for name in names
        for item in items_of(folder / name)
        if item['command'] == mission_items.NAV_LOITER_TIME
    ]
    assert len(stays) == 2  # A and B, wherever either is read


def test_a_mission_that_was_cut_short_is_handed_on_with_a_warning(
    run_folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = run_folder / 'mission_0.jsonl'
    log.write_text(''.join(log.read_text().splitlines(keepends=True)[:5]))
    assert main(['export', str(run_folder), '--to', 'mavlink']) == 0
    assert (
        f'warning: {STEM}: the mission was given up, not all of it was recorded'
        in capsys.readouterr().err
    )


@pytest.mark.parametrize('kind', HANDOVER_KINDS)
def test_a_fleet_that_stays_on_the_ground_has_nothing_to_hand_on(
    kind: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    idle = write_run(tmp_path / 'idle', tiny(), ([], []))
    command = ['export', str(idle), '--to', kind, '--reference', '0', '0']
    assert main(command) == 2
    *lines, error = capsys.readouterr().err.splitlines()
    assert lines == [f'{STEM}: UAV {uav} stayed on the ground: it has no flight' for uav in (1, 2)]
    assert error == 'error: export: no flight of any UAV is known: there is nothing to hand on'


def test_a_uav_whose_decisions_were_not_recorded_is_not_said_to_have_stayed(
    run_folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = run_folder / 'mission_0.jsonl'
    log.write_text(''.join(log.read_text().splitlines(keepends=True)[:2]))
    assert main(['export', str(run_folder), '--to', 'kml']) == 0
    said = capsys.readouterr().err.splitlines()
    assert (
        f'{STEM}: UAV 2 has no flight: none of its decisions was recorded,'
        ' it is not known whether it flew'
    ) in said


def test_a_log_that_does_not_add_up_is_not_handed_on(
    run_folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = run_folder / 'mission_0.jsonl'
    log.write_text(log.read_text().replace('"x_m": 75.0', '"x_m": 175.0', 1))
    assert main(['export', str(run_folder), '--to', 'plan']) == 2
    assert f'error: {log}: event ' in capsys.readouterr().err
    assert exported(run_folder) == set()


@pytest.mark.parametrize(
    ('arguments', 'words'),
    [
        (['--to', 'kml'], 'must be given either PATH, a recording, or --plan'),
        (['RUN', '--plan', 'shortest', '--to', 'kml'], 'must be given either PATH'),
        (['RUN', '--seed', '3', '--to', 'kml'], 'tells its scenario and seed itself'),
        (['RUN', '--to', 'kml', '--bandwidth', 'equal'], '--seed and --bandwidth are for --plan'),
        (['RUN', '--to', 'kml', '--output', __file__], f'{__file__}: must be a folder'),
        (
            ['RUN', '--to', 'kml', '--start', '9999-12-31T23:59:59Z'],
            'tiny, mission seed 0: 10 s after 9999-12-31 is beyond the year 9999',
        ),
        (['RUN', '--to', 'kml', 'kml'], '--to kml kml: names one twice'),
        (
            ['RUN', '--to', 'csv', '--reference', '10', '20.5'],
            '--reference 10 20.5: must be left out, as tiny has its own area.reference, 52.22 6.89'
            ' deg',
        ),
        (
            ['RUN', '--to', 'kml', '--reference', '91', '0'],
            'must be a latitude from -89 to 89 deg',
        ),
        (
            ['RUN', '--to', 'kml', '--reference', 'nan', '0'],
            'must be a latitude from -89 to 89 deg',
        ),
    ],
)
def test_export_says_what_is_wrong_in_a_line(
    run_folder: Path, arguments: list[str], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    given = [str(run_folder) if word == 'RUN' else word for word in arguments]
    assert main(['export', *given]) == 2
    [line] = capsys.readouterr().err.splitlines()
    assert words in line
    assert exported(run_folder) == set()


@pytest.mark.parametrize(
    ('arguments', 'words'),
    [
        (['--to', 'shape'], "invalid choice: 'shape'"),
        (['--to', 'csv', '--rate-hz', '0'], "'0' must be a number from 1e-06 to 1000 Hz"),
        (
            ['--to', 'kml', '--start', '2026-06-01T08:00:00'],
            'must be a time from 1900 on with its zone',
        ),
        (['--to', 'kml', '--start', 'noon'], 'must be a time from 1900 on with its zone'),
        (['--to', 'kml', '--start', '0999-01-01T00:00:00Z'], 'must be a time from 1900 on'),
    ],
)
def test_export_is_misused_in_a_line(
    arguments: list[str], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as stopped:
        main(['export', 'run', *arguments])
    assert stopped.value.code == 2
    [line] = capsys.readouterr().err.splitlines()
    assert words in line
