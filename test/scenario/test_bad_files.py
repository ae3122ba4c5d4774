"""Files that are no scenario at all, scenarios that are too large, and names that are no names."""

from collections.abc import Callable
import json
import os
from pathlib import Path

import pytest
from uav_collect.config import layers
from uav_collect.errors import ConfigError
from uav_collect.scenario.load import from_file, from_yaml, load

NO_FILE = 'cannot be read: is a pipe or a device: must be a file'
TOO_LARGE = 'cannot be read: has 50,000,000 bytes: must have at most 16,777,216'
NAME = 'must be 1 to 64 letters of A to Z, digits, _, - and ., the first a letter or a digit'

SITE = 'extends: paper_10x10\nsensors: {kind: csv, file: %s, origin: auto}\n'
HEIR = 'extends: ./%s\n'


@pytest.fixture(autouse=True)
def _here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def problems_of(name: str, **overrides: object) -> tuple[str, ...]:
    with pytest.raises(ConfigError) as caught:
        load(name, {key.replace('__', '.'): value for key, value in overrides.items()})
    return caught.value.problems


def make_pipe(path: Path) -> None:
    os.mkfifo(path)


def make_device(path: Path) -> None:
    path.symlink_to('/dev/zero')


def make_large(path: Path) -> None:
    path.touch()
    os.truncate(path, 50_000_000)


def make_latin(path: Path) -> None:
    path.write_bytes('\nÖ'.encode('latin-1'))


def make_circle(path: Path) -> None:
    path.symlink_to(path.name)


LISTS = {  # what of these is not said of a list of sensors
    f': {TOO_LARGE}': ':1: must be text, but is UTF-8 with the character U+0000',
    ':2: must be UTF-8 text: unexpected end of data': (
        ': has no sensors: must have at least one line below the header'
    ),
}

BAD_FILES: dict[str, tuple[Callable[[Path], None], str]] = {
    'pipe': (make_pipe, f': {NO_FILE}'),
    'device': (make_device, f': {NO_FILE}'),
    'large': (make_large, f': {TOO_LARGE}'),
    'folder': (Path.mkdir, ': cannot be read: is a folder: must be a file'),
    'latin': (make_latin, ':2: must be UTF-8 text: unexpected end of data'),
}


@pytest.mark.parametrize(('make', 'problem'), BAD_FILES.values(), ids=BAD_FILES)
def test_what_is_no_text_file_is_one_line_at_once(
    make: Callable[[Path], None], problem: str
) -> None:
    make(Path('bad.yaml'))
    assert problems_of('bad.yaml') == (f'bad.yaml{problem}',)


@pytest.mark.parametrize(('make', 'problem'), BAD_FILES.values(), ids=BAD_FILES)
def test_what_is_extended_is_read_as_carefully(make: Callable[[Path], None], problem: str) -> None:
    Path('site.yaml').write_text(HEIR % 'bad.yaml')
    make(Path('bad.yaml'))
    assert problems_of('site.yaml') == (f'site.yaml:1: extends bad.yaml{problem}',)


@pytest.mark.parametrize(('make', 'problem'), BAD_FILES.values(), ids=BAD_FILES)
def test_sensors_are_read_as_carefully(make: Callable[[Path], None], problem: str) -> None:
    Path('site.yaml').write_text(SITE % 'bad.csv')
    make(Path('bad.csv'))
    problem = LISTS.get(problem, problem)
    no_file = "sensors.file is 'bad.csv': must be a list of sensors, but there is no bad.csv"
    wanted = f'site.yaml:2: {no_file}' if make is Path.mkdir else f'bad.csv{problem}'
    assert problems_of('site.yaml') == (wanted,)


@pytest.mark.parametrize(('make', 'problem'), BAD_FILES.values(), ids=BAD_FILES)
def test_a_scenario_that_a_mission_kept_is_read_as_carefully(
    make: Callable[[Path], None], problem: str
) -> None:
    make(Path('kept.yaml'))
    with pytest.raises(ConfigError) as caught:
        from_file(Path('kept.yaml'))
    assert caught.value.problems == (f'kept.yaml{problem}',)


def test_a_scenario_that_a_mission_kept_reads_the_same() -> None:
    scenario = load('rough_10x10')
    Path('kept.yaml').write_text(scenario.to_yaml())
    assert from_file(Path('kept.yaml')) == scenario


def test_a_link_to_itself_is_one_line() -> None:
    make_circle(Path('loop.yaml'))
    (line,) = problems_of('loop.yaml')
    assert line.startswith('loop.yaml: cannot be read: ')


@pytest.mark.parametrize('name', ['n' * 300, './' + 'n' * 300 + '.yaml', 'a\0.yaml', 'a\n.yaml'])
def test_a_name_that_no_file_can_have_is_one_short_line(name: str) -> None:
    (line,) = problems_of(name)
    assert line.isprintable()
    assert len(line) < 400


@pytest.mark.parametrize(
    'name', ['n' * 300, 'n' * 2_000, './' + 'n' * 300 + '.yaml', 'deep/' * 100]
)
def test_a_file_that_cannot_be_there_is_one_short_line(name: str) -> None:
    Path('site.yaml').write_text(f'extends: {name}\n')
    (line,) = problems_of('site.yaml')
    assert line.startswith('site.yaml:1: extends ')
    assert len(line) < 400
    Path('site.yaml').write_text(SITE % name)
    (line,) = problems_of('site.yaml')
    assert line.startswith('site.yaml:2: sensors.file is ')
    assert len(line) < 400


def test_at_most_twenty_files_extend_each_other() -> None:
    for number in range(30):
        Path(f'{number}.yaml').write_text(HEIR % f'{number + 1}.yaml')
    assert problems_of('0.yaml') == (
        '19.yaml:1: extends 20.yaml: must be one of at most 20 files that extend each other',
    )


def test_a_thousand_wrong_sensors_take_twenty_lines() -> None:
    entries = [f'  - {{id: S{number}, x_m: -1.0, y_m: 5.0}}' for number in range(1000)]
    text = 'extends: paper_10x10\nsensors:\n  kind: listed\n  entries:\n'
    Path('site.yaml').write_text(text + '\n'.join(entries))
    with pytest.raises(ConfigError) as caught:
        load('site.yaml')
    lines = str(caught.value).splitlines()
    rule = 'must be a number from 0 to 640000 m'
    assert lines[0] == f'site.yaml:5: sensors.entries.0.x_m is -1.0: {rule}'
    assert lines[19] == f'site.yaml:24: sensors.entries.19.x_m is -1.0: {rule}'
    assert lines[20:] == ['... and 980 more problems']


def test_a_file_is_parsed_once_however_many_problems_it_has(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    read = []
    original = layers.read_value
    monkeypatch.setattr(layers, 'read_value', lambda *given: read.append(1) or original(*given))
    Path('site.yaml').write_text(f'extends: paper_10x10\nradio: {{{"a: 1, b: 2, c: 3"}}}\n')
    assert len(problems_of('site.yaml')) == 3
    assert len(read) == 2


def test_a_key_without_end_is_shown_in_short() -> None:
    Path('site.yaml').write_text(f'extends: paper_10x10\n{"k" * 900}: 1\n"a\\nb": 1\n')
    lines = problems_of('site.yaml')
    assert len(lines) == 2
    assert all(line.isprintable() and len(line) < 300 for line in lines)


@pytest.mark.parametrize(
    'name', ['../../outside', 'a[/b]', 'a/b', '.hidden', '-n', '', 'a b', 'Ö', 'n' * 65, 'a\n']
)
def test_a_name_is_neither_a_path_nor_markup(name: str) -> None:
    with pytest.raises(ConfigError) as caught:
        load('paper_10x10', {'name': name})
    (line,) = caught.value.problems
    assert line.startswith(f'override: name is {repr(name)[:57]}')
    assert line.endswith(f': {NAME}')
    text = load('paper_10x10').to_yaml().replace('paper_10x10', json.dumps(name))
    with pytest.raises(ConfigError, match='scenario text:1: name is '):
        from_yaml(text)


def test_a_file_whose_name_is_none_must_say_one() -> None:
    Path('my site.yaml').write_text('extends: paper_10x10\n')
    what = "as the file name 'my site' is not"
    assert problems_of('my site.yaml') == (f'my site.yaml: name is missing: {NAME}, {what}',)
    Path('my site.yaml').write_text('extends: paper_10x10\nname: my_site\n')
    assert load('my site.yaml').name == 'my_site'
    assert load('my site.yaml', {'name': 'other'}).name == 'other'


@pytest.mark.parametrize(
    ('keys', 'problem'),
    [
        ({'area__cells_per_side': 64, 'sensors__dense_mean': 900}, 'dense_mean is 900: '),
        ({'area__cells_per_side': 64, 'sensors__sparse_mean': 9}, 'sparse_mean is 9: '),
    ],
)
def test_an_area_of_too_many_sensors_is_refused_before_they_are_drawn(
    keys: dict[str, object], problem: str
) -> None:
    (line,) = problems_of('paper_10x10', **keys)
    assert line.startswith(f'override: sensors.{problem}must be less, as the area has some ')
    assert line.endswith(' sensors by it, at most 20,000')


def test_a_list_of_too_many_sensors_is_refused() -> None:
    entries = [{'id': f'{number}', 'x_m': 1, 'y_m': 1} for number in range(20_001)]
    (line,) = problems_of('paper_10x10', sensors={'kind': 'listed', 'entries': entries})
    assert line == 'override: sensors.entries has 20001 entries: must have at most 20000'


def test_a_fleet_of_too_many_is_refused_before_each_has_its_defaults() -> None:
    Path('site.yaml').write_text(f'extends: paper_10x10\nfleet: {{uavs: [{"{}, " * 100_000}]}}\n')
    (line,) = problems_of('site.yaml')
    assert line == 'site.yaml:2: fleet.uavs has 100000 entries: must have at most 64'


@pytest.mark.parametrize('path', ['.'.join('a' * 10_000), 'a' * 10_000, 'area.' + '1' * 5_000])
def test_an_override_without_end_is_one_short_line(path: str) -> None:
    with pytest.raises(ConfigError) as caught:
        load('paper_10x10', {path: 1})
    assert all(len(line) < 300 for line in caught.value.problems)


def test_numbers_that_are_as_good_as_nothing_are_out_of_range() -> None:
    tiny = {
        'area.cell_size_m': 5e-324, 'area.altitude_m': 1e-200, 'radio.nlos_attenuation': 1e-310,
        'radio.system_bandwidth_mhz': 1e-300, 'reward.scale_mbit': 5e-324,
        'reward.discount_per_s': 1e-320, 'demand.cell_share': 1e-320,
        'demand.data_mbit': [1e-320, 1.0], 'fleet.default.speed_mps': 1e-310,
        'fleet.default.energy_budget_kj': 1e-310,
        'fleet.default.propulsion.tip_speed_mps': 1e-160,
        'fleet.default.propulsion.induced_speed_mps': 1e-160,
        'fleet.default.propulsion.induced_power_w': 5e-324,
        'fleet.default.propulsion.blade_profile_power_w': 5e-324,
    }  # fmt: skip
    for path, value in tiny.items():
        with pytest.raises(ConfigError) as caught:
            load(
                'paper_10x10',
                {path: value, 'fleet.uavs': [{}] if 'speed_mps' in path else [{'speed_mps': 5.0}]},
            )
        assert f'{path} is ' in str(caught.value), path


def test_amounts_of_a_file_are_nothing_or_a_bit_at_least() -> None:
    Path('site.yaml').write_text(f'{SITE % "s.csv"}demand: {{data_mbit: csv}}\n')
    Path('s.csv').write_text('sensor_id,x_m,y_m,data_mbit\na,1,2,1e-310\n')
    rule = 'must be a number from 1e-06 to 10000 Mbit, or 0'
    assert problems_of('site.yaml') == (f"s.csv:2: data_mbit is '1e-310': {rule}",)
