"""What a user may get wrong in a scenario: one line with file, field, value, allowed range."""

import os
from pathlib import Path
import subprocess
import sys
from typing import NamedTuple

from processes import complaints, completed
import pytest
from uav_collect.errors import ConfigError
from uav_collect.scenario.load import from_yaml, load, parse_override
from uav_collect.scenario.site import build_site

LENGTH = 'must be a number from 0.1 to 10000 m'
SHARE = 'must be a number from 1e-09 to 1, or all'
AMOUNTS = (
    'must be a list [low, high], low <= high, of numbers from 1e-06 to 10000 Mbit, low also 0, '
    'or csv'
)
CELLS = 'must be a whole number from 1 to 64'
SEED = 'must be a whole number from 0 to 9223372036854775807'
SPEED = 'must be a number from 0.01 to 100 m/s'
RANGE = 'must be a number >= 0 m, or .inf'
PLACE = 'must be {cell: [row, column]} or {position_m: [x, y]}'
NAME = '1 to 64 letters of A to Z, digits, _, - and ., the first a letter or a digit'
NAMES = 'lillgrund, paper_10x10, paper_15x15, paper_20x20, paper_8x8, rough_10x10'
SECTIONS = 'name, area, sensors, demand, radio, reward, fleet, faults'
MAPPING = 'must be a mapping of keys'
NOT_UTF8 = 'must be UTF-8 text: invalid continuation byte'

SITE = """extends: paper_10x10
sensors:
  kind: csv
  file: sensors.csv
  origin: auto
"""


class Case(NamedTuple):
    """A mistake, and the line that reports it."""

    name: str
    text: str  # the file's, below "extends: paper_10x10" on line 1
    line: int
    problem: str


YAML_CASES = (
    Case('unknown key', 'demand: {phi: 0.3}', 2,
         'demand.phi is an unknown key: must be one of cell_share, data_mbit, known_empty'),
    Case('unknown section', 'wind: {speed_mps: 3}', 2,
         f'wind is an unknown key: must be one of {SECTIONS}'),
    Case('unknown key of the fleet', 'fleet: {defaults: {}}', 2,
         'fleet.defaults is an unknown key: must be one of default, uavs'),
    Case('unknown key of a UAV', 'fleet:\n  uavs:\n  - speed_mps: 5\n    colour: red', 5,
         'fleet.uavs.0.colour is an unknown key: must be one of speed_mps, energy_budget_kj, '
         'energy_margin_kj, start, home, propulsion, battery, airframe, battery_wh, '
         'battery_mah, battery_v, battery_usable_share'),
    Case('number as a key', 'area: {5: 100}', 2, 'area.5 is a key that is not text'),
    Case('number in words', 'area: {cell_size_m: fifty}', 2,
         f"area.cell_size_m is 'fifty': {LENGTH}"),
    Case('number in quotes', 'area: {cell_size_m: "50"}', 2,
         f"area.cell_size_m is '50': {LENGTH}"),
    Case('number with its unit', 'area: {cell_size_m: 50 m}', 2,
         f"area.cell_size_m is '50 m': {LENGTH}"),
    Case('truth as a number', 'area: {altitude_m: yes}', 2, f'area.altitude_m is true: {LENGTH}'),
    Case('list as a number', 'area: {altitude_m: [100]}', 2,
         f'area.altitude_m is [100]: {LENGTH}'),
    Case('number left empty', 'area: {altitude_m: }', 2, f'area.altitude_m is empty: {LENGTH}'),
    Case('part of a cell', 'area: {cells_per_side: 10.5}', 2,
         f'area.cells_per_side is 10.5: {CELLS}'),
    Case('no cells', 'area: {cells_per_side: 0}', 2, f'area.cells_per_side is 0: {CELLS}'),
    Case('too many cells', 'area: {cells_per_side: 65}', 2, f'area.cells_per_side is 65: {CELLS}'),
    Case('negative length', 'area: {cell_size_m: -50}', 2, f'area.cell_size_m is -50: {LENGTH}'),
    Case('on the ground', 'area: {altitude_m: 0.0}', 2, f'area.altitude_m is 0.0: {LENGTH}'),
    Case('not a number', 'area: {altitude_m: .nan}', 2, f'area.altitude_m is .nan: {LENGTH}'),
    Case('beyond floats', f'area: {{altitude_m: 1{"0" * 400}}}', 2,
         f'area.altitude_m is 1{"0" * 56}...: {LENGTH}'),
    Case('infinite', 'radio: {system_bandwidth_mhz: .inf}', 2,
         'radio.system_bandwidth_mhz is .inf: must be a number from 1e-06 to 10000 MHz'),
    Case('Hz for MHz', 'radio: {system_bandwidth_mhz: 1e6}', 2,
         'radio.system_bandwidth_mhz is 1000000.0: must be a number from 1e-06 to 10000 MHz'),
    Case('GHz for Hz', 'radio: {carrier_hz: 2.4}', 2,
         'radio.carrier_hz is 2.4: must be a number from 1000000 to 3e+11 Hz'),
    Case('W for dBm', 'radio: {noise_dbm_per_hz: 1e-18}', 2,
         'radio.noise_dbm_per_hz is 1e-18: must be a number from -250 to 0 dBm/Hz'),
    Case('mW for dBm', 'radio: {tx_power_dbm: 100}', 2,
         'radio.tx_power_dbm is 100: must be a number from -50 to 60 dBm'),
    Case('better than free space', 'radio: {path_loss_exponent: 1.9}', 2,
         'radio.path_loss_exponent is 1.9: must be a number from 2 to 6'),
    Case('dB for linear', 'radio: {nlos_attenuation: -7}', 2,
         'radio.nlos_attenuation is -7: must be a number from 1e-06 to 1'),
    Case('no antenna', 'radio: {n_antennas: 0}', 2,
         'radio.n_antennas is 0: must be a whole number from 1 to 64'),
    Case('negative variance', 'radio: {csi_error_variance: -0.1}', 2,
         'radio.csi_error_variance is -0.1: must be a number from 0 to 1'),
    Case('negative range', 'radio: {contact_range_m: -1}', 2,
         f'radio.contact_range_m is -1: {RANGE}'),
    Case('range not a number', 'radio: {contact_range_m: .nan}', 2,
         f'radio.contact_range_m is .nan: {RANGE}'),
    Case('share in percent', 'demand: {cell_share: 30}', 2, f'demand.cell_share is 30: {SHARE}'),
    Case('share of nothing', 'demand: {cell_share: 0}', 2, f'demand.cell_share is 0: {SHARE}'),
    Case('share in words', 'demand: {cell_share: most}', 2,
         f"demand.cell_share is 'most': {SHARE}"),
    Case('one amount', 'demand: {data_mbit: 0.5}', 2, f'demand.data_mbit is 0.5: {AMOUNTS}'),
    Case('amounts turned round', 'demand: {data_mbit: [1.0, 0.1]}', 2,
         f'demand.data_mbit is [1.0, 0.1]: {AMOUNTS}'),
    Case('negative amount', 'demand: {data_mbit: [-1, 1]}', 2,
         f'demand.data_mbit is [-1, 1]: {AMOUNTS}'),
    Case('no data anywhere', 'demand: {data_mbit: [0, 0]}', 2,
         f'demand.data_mbit is [0, 0]: {AMOUNTS}'),
    Case('three amounts', 'demand: {data_mbit: [1, 2, 3]}', 2,
         f'demand.data_mbit is [1, 2, 3]: {AMOUNTS}'),
    Case('amounts of drawn sensors', 'demand: {data_mbit: csv}', 2,
         'demand.data_mbit is csv: must be a list [low, high], as the sensors are drawn'),
    Case('discount above one', 'reward: {discount_per_s: 1.01}', 2,
         'reward.discount_per_s is 1.01: must be a number from 1e-06 to 1'),
    Case('negative seed', 'sensors: {seed: -1}', 2, f'sensors.seed is -1: {SEED}'),
    Case('seed of 64 bits', 'sensors: {seed: 9223372036854775808}', 2,
         f'sensors.seed is 9223372036854775808: {SEED}'),
    Case('unknown kind', 'sensors: {kind: random}', 2,
         "sensors.kind is 'random': must be drawn, csv or listed"),
    Case('section as a list', 'sensors: [1, 2]', 2, f'sensors is [1, 2]: {MAPPING}'),
    Case('section left empty', 'radio:', 2, f'radio is empty: {MAPPING}'),
    Case('section as text', 'demand: much', 2, f"demand is 'much': {MAPPING}"),
    Case('no UAVs', 'fleet: {uavs: []}', 2, 'fleet.uavs has 0 entries: must have at least 1'),
    Case('too many UAVs', f'fleet: {{uavs: [{", ".join(["{speed_mps: 5}"] * 65)}]}}', 2,
         'fleet.uavs has 65 entries: must have at most 64'),
    Case('number of UAVs', 'fleet: {uavs: 2}', 2, 'fleet.uavs is 2: must be a list'),
    Case('UAV as a number', 'fleet: {uavs: [5]}', 2, f'fleet.uavs.0 is 5: {MAPPING}'),
    Case('no speed', 'fleet:\n  uavs:\n  - speed_mps: 5\n  - {}', 5,
         f'fleet.uavs.1.speed_mps is missing: {SPEED}'),
    Case('speed of zero', 'fleet:\n  uavs:\n  - speed_mps: 5\n  - speed_mps: 0', 5,
         f'fleet.uavs.1.speed_mps is 0: {SPEED}'),
    Case('negative budget', 'fleet:\n  default:\n    energy_budget_kj: -4', 4,
         'fleet.default.energy_budget_kj is -4: must be a number from 0.001 to 1000000 kJ'),
    Case('budget below the margin', 'fleet:\n  default:\n    energy_budget_kj: 0.5', 4,
         'fleet.default.energy_budget_kj is 0.5 kJ: must be more than energy_margin_kj, 1 kJ'),
    Case('default as text', 'fleet: {default: fast}', 2, f"fleet.default is 'fast': {MAPPING}"),
    Case('start outside', 'fleet: {default: {start: {cell: [10, 0]}}}', 2,
         'fleet.default.start.cell is [10, 0]: '
         'must be a list [row, column] of whole numbers from 0 to 9'),
    Case('start between cells', 'fleet: {default: {start: {position_m: [50, 25]}}}', 2,
         'fleet.default.start.position_m is [50.0, 25.0]: '
         'must be the centre of a cell of the area'),
    Case('start as a list', 'fleet: {default: {start: [0, 0]}}', 2,
         f'fleet.default.start is [0, 0]: {PLACE}'),
    Case('start twice', 'fleet: {default: {start: {cell: [0, 0], position_m: [25, 25]}}}', 2,
         f"fleet.default.start is {{'cell': [0, 0], 'position_m': [25, 25]}}: {PLACE}"),
    Case('home outside', 'fleet: {default: {home: {position_m: [25, 501]}}}', 2,
         'fleet.default.home.position_m is [25.0, 501.0]: must be from 0 to 500 m'),
    Case('rotor that stands', 'fleet: {default: {propulsion: {tip_speed_mps: 0}}}', 2,
         'fleet.default.propulsion.tip_speed_mps is 0: must be a number from 1 to 1000 m/s'),
    Case('name on two lines', 'name: "a\\nb"', 2,
         f"name is 'a\\nb': must be {NAME}"),
    Case('key twice', 'area:\n  altitude_m: 100\n  altitude_m: 120', 4,
         "area is not valid YAML: the key 'altitude_m' appears twice"),
    Case('tab', 'area:\n\taltitude_m: 100', 3,
         'is not valid YAML: while scanning for the next token, '
         'found character that cannot start any token'),
    Case('open bracket', 'area: {altitude_m: 100', 3,
         "is not valid YAML: while parsing a flow mapping, did not find expected ',' or '}'"),
    Case('two documents', '---\narea: {altitude_m: 100}', 2,
         'is not valid YAML: expected a single document in the stream, '
         'but found another document'),
    Case('unknown tag', 'area: !!python/name:os.system', 2,
         "area has the tag '!!python/name:os.system': must be without tags, as !!int or !name"),
    Case('sensor twice', 'sensors:\n  kind: listed\n  entries:\n'
         '  - {id: a, x_m: 1, y_m: 2}\n  - {id: a, x_m: 3, y_m: 4}', 6,
         "sensors.entries.1.id is 'a': must be unique"),
    Case('listed sensor outside', 'sensors: {kind: listed, entries: [{id: a, x_m: 501, y_m: 2}]}',
         2, 'sensors.entries.0.x_m is 501: must be from 0 to 500 m'),
    Case('no listed sensors', 'sensors: {kind: listed, entries: []}', 2,
         'sensors.entries has 0 entries: must have at least 1'),
    Case('CSV file missing', 'sensors: {kind: csv, file: no.csv, origin: auto}', 2,
         "sensors.file is 'no.csv': must be a list of sensors, but there is no no.csv"),
    Case('CSV file not named', 'sensors: {kind: csv, origin: auto}', 2,
         'sensors.file is missing: must be text of 1 to 4096 printable characters'),
    Case('origin in words', 'sensors: {kind: csv, file: no.csv, origin: centre}', 2,
         "sensors.origin is 'centre': must be a list of two numbers, or auto"),
)  # fmt: skip

OVERRIDE_CASES = (
    ('radio.bandwidth=3', 'radio.bandwidth is an unknown key: must be one of carrier_hz, '),
    ('demand.cell_share=2', f'demand.cell_share is 2: {SHARE}'),
    ('fleet.uavs.2.speed_mps=5', "fleet.uavs.2.speed_mps has no place: 2 is not in [{'speed_mps'"),
    ('area.altitude_m.x=5', "area.altitude_m.x has no place: 'x' is not in 100.0"),
    ('demand.data_mbit.0=5', f'demand.data_mbit is [5, 1.0]: {AMOUNTS}'),
    ('demand.cell_share', "'demand.cell_share' must be KEY=VALUE, as demand.cell_share=0.5"),
    ('demand.cell_share=[', "demand.cell_share is '[': must be a YAML value"),
)


@pytest.fixture(autouse=True)
def _here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def problems_of(name: str) -> tuple[str, ...]:
    with pytest.raises(ConfigError) as caught:
        load(name)
    return caught.value.problems


@pytest.mark.parametrize('case', YAML_CASES, ids=lambda case: case.name)
def test_a_wrong_value_is_one_line_with_file_field_value_and_range(case: Case) -> None:
    Path('site.yaml').write_text(f'extends: paper_10x10\n{case.text}\n')
    assert problems_of('site.yaml') == (f'site.yaml:{case.line}: {case.problem}',)


@pytest.mark.parametrize(('assignment', 'problem'), OVERRIDE_CASES)
def test_a_wrong_override_is_one_line_that_says_so(assignment: str, problem: str) -> None:
    with pytest.raises(ConfigError) as caught:
        load('paper_10x10', dict([parse_override(assignment)]))
    (line,) = caught.value.problems
    assert line.startswith(f'override: {problem}')


@pytest.mark.parametrize(
    ('sensors', 'reason'),
    [
        ('sensor_id,x_m,y_m\na,1,2', 'sensor a has no data_mbit'),
        ('sensor_id,x_m,y_m,data_mbit\na,1,2,0', 'all data_mbit are 0'),
    ],
)
def test_amounts_that_the_csv_does_not_give_are_refused(sensors: str, reason: str) -> None:
    Path('site.yaml').write_text(f'{SITE}demand: {{data_mbit: csv}}')
    Path('sensors.csv').write_text(sensors)
    problem = f'demand.data_mbit is csv: must be a list [low, high], as {reason}'
    assert problems_of('site.yaml') == (f'site.yaml:6: {problem}',)


@pytest.mark.parametrize(
    ('name', 'problem'),
    [
        ('no.yaml', 'no.yaml: cannot be read: No such file or directory'),
        ('folder.yaml', 'folder.yaml: cannot be read: is a folder: must be a file'),
        ('paper_9x9', f"scenario is 'paper_9x9': must be a .yaml file or one of {NAMES}"),
    ],
)
def test_a_scenario_that_is_not_there_is_one_line(name: str, problem: str) -> None:
    Path('folder.yaml').mkdir()
    assert problems_of(name) == (problem,)


@pytest.mark.parametrize(
    ('text', 'problem'),
    [
        ('', 'site.yaml: is empty: must be a mapping of keys'),
        ('- area', "site.yaml: is ['area']: must be a mapping of keys"),
        ('just text', "site.yaml: is 'just text': must be a mapping of keys"),
        (
            'extends: [a]',
            "site.yaml:1: extends is ['a']: must be a .yaml file or a scenario name",
        ),
        (
            'extends: base.yaml',
            'site.yaml:1: extends base.yaml: cannot be read: No such file or directory',
        ),
        (
            'extends: base',
            f"site.yaml:1: extends is 'base': must be a .yaml file or one of {NAMES}",
        ),
        (
            'extends: ./site.yaml',
            'site.yaml:1: extends must not lead back to itself: site.yaml -> site.yaml',
        ),
        ('name: \x01', 'site.yaml:1: is not valid YAML: the character U+0001 is not allowed'),
    ],
)
def test_a_file_that_is_no_scenario_is_one_line(text: str, problem: str) -> None:
    Path('site.yaml').write_text(text)
    (line,) = problems_of('site.yaml')
    assert line.startswith(problem)
    assert '\n' not in line


def test_a_circle_of_files_is_named_from_end_to_end() -> None:
    Path('a.yaml').write_text('extends: b.yaml')
    Path('b.yaml').write_text('extends: a.yaml')
    line = 'a.yaml:1: extends must not lead back to itself: a.yaml -> b.yaml -> a.yaml'
    assert problems_of('a.yaml') == (line,)


def test_text_that_is_not_utf8_is_one_line_with_its_number() -> None:
    Path('site.yaml').write_bytes('extends: paper_10x10\nname: Öresund\n'.encode('latin-1'))
    assert problems_of('site.yaml') == (
        'site.yaml:2: must be UTF-8 text: invalid continuation byte',
    )


def test_a_mistake_in_the_base_file_names_the_base_file() -> None:
    Path('base.yaml').write_text('extends: paper_10x10\narea:\n  altitude_m: -3\n')
    Path('site.yaml').write_text('extends: base.yaml\nname: site\n')
    assert problems_of('site.yaml') == (f'base.yaml:3: area.altitude_m is -3: {LENGTH}',)


def test_each_of_several_mistakes_has_its_line_up_to_twenty() -> None:
    mistakes = ', '.join(f'key_{number}: 0' for number in range(22))
    Path('site.yaml').write_text(f'extends: paper_10x10\nradio: {{{mistakes}}}\n')
    with pytest.raises(ConfigError) as caught:
        load('site.yaml')
    lines = str(caught.value).splitlines()
    assert len(caught.value.problems) == 22
    assert lines[19].startswith('site.yaml:2: radio.key_19 is an unknown key')
    assert lines[20:] == ['... and 2 more problems']


def test_missing_keys_are_all_named_with_what_they_must_be() -> None:
    Path('site.yaml').write_text('area: {cells_per_side: 3, cell_size_m: 50, altitude_m: 9}\n')
    problems = problems_of('site.yaml')
    assert problems[0] == 'site.yaml: sensors is missing: must be a mapping with kind'
    missing = [line.split()[1] for line in problems]
    assert missing == ['sensors', 'demand', 'radio', 'reward', 'fleet']


def test_a_text_that_does_not_stand_alone_is_refused() -> None:
    text = load('paper_10x10').to_yaml()
    with pytest.raises(ConfigError, match='extends is an unknown key'):
        from_yaml(f'{text}extends: paper_8x8\n')
    with pytest.raises(ConfigError, match=r"sensors\.kind is 'csv': must be one of 'drawn', "):
        from_yaml(text.replace('kind: drawn', 'kind: csv'))
    with pytest.raises(ConfigError, match=r'fleet\.default is an unknown key'):
        from_yaml(text.replace('fleet:', 'fleet:\n  default: {}'))


def test_a_seed_that_draws_no_sensor_is_refused() -> None:
    empty = load('paper_10x10', {'sensors.dense_mean': 0, 'sensors.sparse_mean': 0})
    with pytest.raises(ConfigError, match=r'sensors\.seed is 35: draws an area without sensors'):
        build_site(empty)


def evaluate(*arguments: str) -> subprocess.CompletedProcess[str]:
    """A command that is misused."""
    command = (sys.executable, '-m', 'uav_collect', 'evaluate', '--missions', '1', *arguments)
    paths = [str(Path(__file__).parents[2]), os.environ.get('PYTHONPATH', '')]
    environment = os.environ | {'PYTHONPATH': os.pathsep.join(paths)}
    return completed(*command, status=2, env=environment)


@pytest.mark.parametrize(
    ('arguments', 'problem'),
    [
        (('--scenario', 'no.yaml'), 'no.yaml: cannot be read: No such file or directory'),
        (
            ('--scenario', 'site.yaml'),
            "sensors.csv:2: sensor_id is 'a', as in line 3: must be unique, or doubles: first, or "
            'last, to keep one row',
        ),
        (
            ('--set', 'area.cell_size_m=-50'),
            f'override: area.cell_size_m is -50: {LENGTH}',
        ),
        (
            ('--set', 'sensors.dense_mean=0', 'sensors.sparse_mean=0'),
            'sensors.seed is 35: draws an area without sensors, must be another seed, '
            'or the means larger',
        ),
    ],
)
def test_a_command_shows_the_line_and_exits_with_status_2(
    arguments: tuple[str, ...], problem: str
) -> None:
    Path('site.yaml').write_text(SITE)
    Path('sensors.csv').write_text('sensor_id,x_m,y_m\na,1,2\na,3,4\n')
    done = evaluate(*arguments)
    assert done.stdout == ''
    assert complaints(done.stderr) == [f'error: {problem}']


def test_a_budget_that_cannot_pay_for_the_way_home_is_refused_with_numbers() -> None:
    done = evaluate('--set', 'fleet.default.energy_budget_kj=1.5')
    assert done.stdout == ''
    *_, line = done.stderr.splitlines()
    assert line.startswith('error: scenario paper_10x10: ')
    assert 'UAV 1 has 1.5 kJ' in line
    assert 'Traceback' not in done.stderr
