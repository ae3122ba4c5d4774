"""The command field."""

from contextlib import redirect_stdout
from io import StringIO
import json
import os
from pathlib import Path

from interpreted import interpreted
from logger_lists import LISTS, write_list
import numpy as np
from processes import complaints
import pytest
from uav_collect.__main__ import main
from uav_collect.analysis.metrics import mission_metrics
from uav_collect.missions.rollout import fly
from uav_collect.scenario.load import load
from uav_collect.scenario.site import build_site

SWITCH = 'UAV_COLLECT_KERNELS'


@pytest.fixture(autouse=True)
def kernels_of_this_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """Undo what the command says of kernels: it has a process of its own elsewhere."""
    monkeypatch.setenv(SWITCH, os.environ.get(SWITCH) or 'compiled')


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder, the working directory."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def field(*arguments: object) -> int:
    return main(['field', *map(str, arguments)])


@pytest.fixture(scope='module')
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, str]]:
    """A folder with the scenario of each list for three UAVs, and what was printed of it."""
    folder, printed = tmp_path_factory.mktemp('fields'), {}
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(SWITCH, 'interpreted')
        patch.chdir(folder)
        for name, (_, options) in LISTS.items():
            with redirect_stdout(StringIO()) as said:
                assert field(write_list(name, folder), *options, '--uavs', 3) == 0
            printed[name] = said.getvalue()
    return folder, printed


@pytest.mark.parametrize('name', LISTS)
def test_a_list_of_any_kind_becomes_a_scenario_without_an_edit(
    name: str, made: tuple[Path, dict[str, str]]
) -> None:
    folder, printed = made
    stem = Path(name).stem
    site = build_site(load(folder / f'{stem}.yaml'))
    assert site.n_sensors >= 3
    assert site.scenario.name == stem
    assert site.scenario.n_uavs == 3
    assert (folder / f'{stem}.png').read_bytes().startswith(b'\x89PNG')
    assert printed[name].endswith(f'next: python -m uav_collect mission --scenario {stem}.yaml\n')


def flown() -> str:
    """Whether a mission over each of some fields collects all, and its UAVs land in time."""
    words = []
    for path in sorted(Path().glob('*.yaml')):
        [log] = fly(build_site(load(path)), [0], 'sweep')
        metrics = mission_metrics(log)
        words.append(f'{path.stem} {metrics.is_complete and metrics.is_safe}')
    return '\n'.join(words)


def test_what_is_proposed_is_flown_to_the_end(
    made: tuple[Path, dict[str, str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(made[0])
    ends = dict(line.split() for line in interpreted(flown).splitlines())
    assert ends == {Path(name).stem: 'True' for name in LISTS}


def test_the_summary_says_what_was_proposed(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert field(write_list('pipeline.csv', here)) == 0
    printed = capsys.readouterr().out
    for words in ('pipeline.csv, metres of its own', '16 on 3,000 m x 80 m', ' kJ', 'dji_m30'):
        assert words in printed
    assert "x and y       count from the area's south-west corner, which is at x = " in printed
    who = 'who flies it best: python -m uav_collect evaluate --scenario pipeline.yaml'
    assert f'{who} --policy best sweep hert --missions 100\n' in printed
    assert 'not known, but waypoints need it: --crs EPSG:N' in printed
    assert 'how much data sensors hold, as a column data_mbit would: taken as 0.1' in printed


def test_the_next_command_in_a_checkout_is_one_of_make(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(Path(__file__).parents[2])
    assert field(write_list('pipeline.csv', tmp_path), '--output', tmp_path) == 0
    path = os.path.relpath(tmp_path / 'pipeline.yaml')
    assert capsys.readouterr().out.endswith(f'next: make mission SCENARIO={path}\n')


def test_a_fleet_whose_energy_is_not_enough_for_the_field_is_a_note(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = write_list('pipeline.csv', here)
    assert field(path, '--battery-wh', 20) == 0
    assert "the fleet's energy reaches about " in capsys.readouterr().out
    assert field(path, '--battery-wh', 200, '--force') == 0
    assert "the fleet's energy" not in capsys.readouterr().out


def test_each_uav_flies_at_the_speed_that_is_given_for_it(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = write_list('pipeline.csv', here)
    assert field(path, '--speed', 10, 15) == 0
    assert [it.speed_mps for it in load(here / 'pipeline.yaml').uavs] == [10.0, 15.0]
    assert ' at 10 and 15 m/s and ' in capsys.readouterr().out
    assert field(path, '--speed', 12, '--uavs', 3, '--force') == 0
    assert [it.speed_mps for it in load(here / 'pipeline.yaml').uavs] == [12.0] * 3


def test_nothing_is_written_over_without_force(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = write_list('pipeline.csv', here)
    (here / 'pipeline.png').write_text('a picture of mine')
    assert field(path) == 2
    assert 'pipeline.png: is there already' in capsys.readouterr().err
    assert not (here / 'pipeline.yaml').exists()
    assert field(path, '--force') == 0
    assert (here / 'pipeline.png').read_bytes().startswith(b'\x89PNG')


def test_files_have_the_name_and_the_folder_that_are_asked_for(here: Path) -> None:
    (here / 'sites').mkdir()
    path = write_list('pipeline.csv', here)
    assert field(path, '--output', 'sites', '--name', 'pipe-1') == 0
    assert load(here / 'sites' / 'pipe-1.yaml').name == 'pipe-1'


def test_a_name_is_made_of_a_file_name_that_can_be_none(here: Path) -> None:
    path = write_list('pipeline.csv', here).rename(here / 'Mein Feld (2).csv')
    assert field(path) == 0
    assert load(here / 'Mein_Feld_2.yaml').n_uavs == 2


@pytest.mark.parametrize(
    ('base', 'east_m'), [('km3.0', 3000.0), ('0,2460', 0.0), ('900,2500', 900.0)]
)
def test_a_base_is_where_it_is_asked_for(base: str, east_m: float, here: Path) -> None:
    assert field(write_list('pipeline.csv', here), '--base', base, '--cell-size', 200) == 0
    site = build_site(load(here / 'pipeline.yaml'))
    start_m = site.position_m[site.sensor_ids.index('km0.0')][0]
    [uav, other] = site.scenario.uavs
    assert abs(uav.start_m[0] - start_m - east_m) <= 100.0
    assert uav.home_m == other.start_m == uav.start_m


@pytest.mark.parametrize(
    ('name', 'base', 'lat_lon_deg'),
    [
        ('vineyard.csv', '44.801,-0.601', (44.801, -0.601)),
        # A list in UTM, each row with its zone; 55.5123 N, 12.8054 E
        ('gauges.csv', '361400,6154000', (55.5123, 12.8054)),
        ('gauges.csv', '55.5123,12.8054', (55.5123, 12.8054)),
    ],
)
def test_a_base_on_earth_is_given_as_the_list_gives_places_or_in_degrees(
    name: str, base: str, lat_lon_deg: tuple[float, float], here: Path
) -> None:
    path = write_list(name, here)
    assert field(path, '--base', base) == 0
    scenario = load(path.with_suffix('.yaml'))
    area, uav = scenario.area, scenario.uavs[0]
    assert area.reference is not None
    lat_deg, lon_deg = area.reference.lat_lon_deg(*uav.start_m)
    assert abs(lat_deg - lat_lon_deg[0]) < area.cell_size_m / 111e3
    assert abs(lon_deg - lat_lon_deg[1]) < area.cell_size_m / 60e3


def test_a_map_is_of_the_earth_whatever_grid_the_list_is_of(here: Path) -> None:
    path = write_list('wells.txt', here)  # around 51.504 N, 0.128 W
    ring = [[-0.14, 51.49], [-0.1, 51.49], [-0.1, 51.52], [-0.14, 51.52], [-0.14, 51.49]]
    (here / 'area.json').write_text(json.dumps({'type': 'Polygon', 'coordinates': [ring]}))
    assert field(path, '--crs', 'EPSG:27700', '--area', 'area.json') == 0
    area = load(here / 'wells.yaml').area
    assert area.boundary is not None
    assert area.reference is not None
    assert area.crs == 'EPSG:27700'
    places = [area.reference.lat_lon_deg(*corner) for corner in area.boundary]
    assert np.array(places) == pytest.approx(np.array(ring)[:4, ::-1], abs=1e-7)


def test_polygons_of_files_close_cells(here: Path) -> None:
    path = write_list('pipeline.csv', here)
    (here / 'area.csv').write_text('x_m,y_m\n-100,2000\n3200,2000\n3200,3200\n-100,3200\n')
    (here / 'zone.csv').write_text('x_m,y_m\n1000,2650\n1400,2650\n1400,2900\n1000,2650\n')
    assert field(path, '--area', 'area.csv', '--no-fly', 'zone.csv') == 0
    area = load(here / 'pipeline.yaml').area
    assert len(area.boundary or ()) == 4
    assert [len(zone) for zone in area.no_fly or ()] == [3]
    assert area.height_m >= 1000.0  # middles of cells lie within 1200 m


def test_a_hole_in_the_area_is_closed_and_a_zone_elsewhere_is_a_note(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    corners = [(11.49, 48.09), (11.51, 48.09), (11.51, 48.11), (11.49, 48.11)]
    hole = [(11.494, 48.094), (11.496, 48.094), (11.496, 48.096), (11.494, 48.096)]
    rings = [[*ring, ring[0]] for ring in (corners, hole)]
    (here / 'area.json').write_text(json.dumps({'type': 'Polygon', 'coordinates': rings}))
    (here / 'zone.csv').write_text('lat,lon\n49,11.5\n49,11.51\n49.01,11.5\n')
    (here / 'wells.csv').write_text('id,lat,lon\na,48.1,11.5\nb,48.101,11.501\n')
    assert field('wells.csv', '--area', 'area.json', '--no-fly', 'zone.csv') == 0
    zones = load(here / 'wells.yaml').area.no_fly or ()
    assert [len(zone) for zone in zones] == [4, 3]
    said = capsys.readouterr().out
    assert 'of them closed' in said
    assert 'no-fly zone 2 of 2, with a corner at x = ' in said
    assert 'no-fly zone 1' not in said


def _outline_and_pond(here: Path, pond: str) -> None:
    """A list of two wells, wells.csv, and their field and a pond in it, field.json."""
    (here / 'wells.csv').write_text('id,lat,lon\na,48.1,11.5\nb,48.101,11.501\n')
    outline = [(11.49, 48.09), (11.51, 48.09), (11.51, 48.11), (11.49, 48.11)]
    water = [(11.494, 48.094), (11.496, 48.094), (11.496, 48.096), (11.494, 48.096)]
    features = [
        {
            'type': 'Feature',
            'properties': {'name': name},
            'geometry': {'type': 'Polygon', 'coordinates': [[*ring, ring[0]]]},
        }
        for name, ring in (('Farm', outline), (pond, water))
    ]
    (here / 'field.json').write_text(
        json.dumps({'type': 'FeatureCollection', 'features': features})
    )


@pytest.mark.parametrize('again', [(), ('--no-fly', 'field.json')])
def test_one_file_may_have_the_area_and_its_no_fly_zones(
    here: Path, again: tuple[str, ...]
) -> None:
    _outline_and_pond(here, 'No-fly: pond')
    assert field('wells.csv', '--area', 'field.json', *again) == 0
    area = load(here / 'wells.yaml').area
    assert len(area.boundary or ()) == 4
    assert [len(zone) for zone in area.no_fly or ()] == [4]


@pytest.mark.parametrize(
    ('option', 'words'),
    [
        ('--area', '2 polygons that may be the area: must have one, and the others no-fly zones'),
        ('--no-fly', 'field.json: no-fly zone 1 of 2 has all sensors in it: must leave out'),
    ],
)
def test_an_outline_that_is_taken_for_something_else_is_said_in_one_line(
    option: str, words: str, here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    _outline_and_pond(here, 'pond')
    assert field('wells.csv', option, 'field.json') == 2
    [line] = capsys.readouterr().err.splitlines()
    assert words in line


def test_a_zone_over_all_sensors_is_looked_for_in_the_file_that_has_it(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    _outline_and_pond(here, 'pond')
    outline = (here / 'field.json').read_text()
    (here / 'area.json').write_text(outline.replace('Farm', 'no-fly farm'))
    (here / 'zone.csv').write_text('lat,lon\n49,11.5\n49,11.51\n49.01,11.5\n')
    assert field('wells.csv', '--area', 'area.json', '--no-fly', 'zone.csv') == 2
    assert 'area.json: no-fly zone 1 of 1 has all sensors in it' in capsys.readouterr().err


@pytest.mark.parametrize(
    ('arguments', 'words'),
    [
        (('https://example.org/loggers.csv',), 'is an address: must be a file; download it first'),
        (('.',), '.: is a folder: must be a file'),
        (('nowhere.csv',), 'nowhere.csv: No such file'),
        (('pipeline.csv', '--area', 'nowhere.kml'), 'nowhere.kml: No such file'),
        (('pipeline.csv', '--name', 'a/b'), "--name is 'a/b': must be 1 to 64 letters"),
        (('pipeline.csv', '--columns', 'width=a'), "--columns has 'width=a': must be KEY=COLUMN"),
        (('pipeline.csv', '--crs', 'moon'), "--crs is 'moon': must be EPSG:NUMBER"),
        (('pipeline.csv', '--base', 'km9'), "--base is 'km9': must be the id of a sensor, or x_m"),
        (('pipeline.csv', '--area', 'pipeline.csv', '--cell-size', '5'), '--cell-size is 5: must'),
        (('pipeline.csv', '--output', 'missing'), 'missing'),
        (('pipeline.csv', '--base', '900000,0'), 'the sensors and the base are on 900 km x 3 km:'),
        (('pipeline.csv', '--no-fly', 'speck.csv'), 'what was proposed:'),
        (('pipeline.csv', '--data-mbit', '3', '2'), '--data-mbit is 3 2: must be LOW and HIGH'),
        (('pipeline.csv', '--speed', '9', '8', '7'), '--speed is 9 8 7: has 3 speeds [m/s]: must'),
        (('pipeline.csv', '--no-fly', ''), ': is a folder: must be a file'),
        (('pipeline.csv', '--area', 'two.csv'), 'two.csv: has a polygon of 2 corners: must'),
        (('pipeline.csv', '--area', 'vineyard.csv'), 'vineyard.csv: has places in degrees: must'),
    ],
)
def test_what_cannot_be_used_is_said_in_one_line_and_nothing_is_written(
    arguments: tuple[str, ...], words: str, here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_list('pipeline.csv', here)
    write_list('vineyard.csv', here)
    (here / 'two.csv').write_text('x_m,y_m\n0,0\n100,0\n')
    (here / 'speck.csv').write_text('x_m,y_m\n900,0\n900,0.0001\n900.0001,0\n')
    assert field(*arguments) == 2
    (said,) = complaints(capsys.readouterr().err)
    assert words in said
    assert said.startswith('error: ')
    assert list(here.glob('*.yaml')) == list(here.glob('*.png')) == []


def test_bad_rows_and_bad_polygons_are_said_at_once(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    _outline_and_pond(here, 'pond')
    (here / 'line.csv').write_text('lat,lon\n48,11.5\n48.1,11.5\n')
    (here / 'wells.csv').write_text('id,lat,lon\na,48.1,here\nb,there,11.501\n')
    assert field('wells.csv', '--area', 'field.json', '--no-fly', 'line.csv') == 2
    said = capsys.readouterr().err.splitlines()
    words = ["lon is 'here'", "lat is 'there'", '2 polygons that may be', 'of 2 corners']
    assert [word in line for word, line in zip(words, said, strict=True)] == [True] * 4


def test_a_bad_place_and_a_bad_outline_of_one_map_are_said_at_once(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    _outline_and_pond(here, 'pond')
    wells = json.loads((here / 'field.json').read_text())
    place = {'type': 'Point', 'coordinates': [11.5, 98.1]}
    wells['features'].append({'type': 'Feature', 'properties': {}, 'geometry': place})
    (here / 'wells.json').write_text(json.dumps(wells))
    assert field('wells.json') == 2
    said = capsys.readouterr().err.splitlines()
    words = ["lat is '98.1'", 'have polygons that may be the area']
    assert [word in line for word, line in zip(words, said, strict=True)] == [True] * 2


@pytest.mark.parametrize(
    ('options', 'speeds_mps'),
    [
        ('--speed 10 LIST', [10, 10]),
        ('--speed 10 15 LIST', [10, 15]),
        ('--speed 10 15 -- LIST', [10, 15]),
        ('--speed=10 LIST', [10, 10]),
        ('LIST --speed 10 15', [10, 15]),
        ('--speed 10 --uavs 1 LIST', [10]),
    ],
)
def test_speeds_may_stand_before_the_list_or_behind_it(
    options: str, speeds_mps: list[float], here: Path
) -> None:
    path = write_list('pipeline.csv', here)
    assert field(*(path if word == 'LIST' else word for word in options.split())) == 0
    assert [uav.speed_mps for uav in load(here / 'pipeline.yaml').uavs] == speeds_mps


@pytest.mark.parametrize('argument', ['--altitude=0', '--cell-size=x', '--speed=-1', '--uavs=0'])
def test_a_number_out_of_range_is_a_misuse(
    argument: str, here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as raised:
        field(write_list('pipeline.csv', here), argument)
    assert raised.value.code == 2
    assert 'must be a' in capsys.readouterr().err


@pytest.mark.parametrize(
    ('text', 'option'),
    [
        ('id,x_m,y_m\na,0,0\na,5,5\n', 'must be unique, or --doubles first, or last, to keep'),
        ('id,x_m,y_m\na,,\nb,5,5\n', 'must be numbers, or --blanks skip'),
        ('id,x,y\na,0,0\nb,2,2\n', '--columns lon=x,lat=y or --columns x_m=x,y_m=y'),
    ],
)
def test_a_list_is_refused_by_the_option_that_would_help(
    text: str, option: str, here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (here / 'list.csv').write_text(text)
    assert field('list.csv') == 2
    assert option in capsys.readouterr().err
