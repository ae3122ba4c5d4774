"""Reads scenarios: YAML files, and the texts that the world sends.

The only reader of scenario YAML. `load` resolves a file: what it extends, overrides, the fleet's
defaults, cells as places, sensors of a CSV file. What comes out stands alone.
"""

from collections.abc import Iterator, Mapping
from dataclasses import replace
import hashlib
from itertools import cycle, islice
import json
from pathlib import Path
from typing import Any

from uav_collect.config import layers
from uav_collect.config.installed import shared_folders
from uav_collect.config.layers import Document
from uav_collect.config.rules import pair, validated, whole
from uav_collect.config.yaml_text import Keys, shown, shown_path
from uav_collect.errors import ConfigError
from uav_collect.limits import MAX_SENSORS, MAX_UAVS
from uav_collect.scenario import sensor_files
from uav_collect.scenario.model import (
    AreaConfig,
    CsvSensors,
    FleetConfig,
    ListedSensors,
    Scenario,
)


def load(name_or_path: str | Path, overrides: Mapping[str, object] | None = None) -> Scenario:
    """Read a scenario by its name among the shipped ones, or by the path of a YAML file.

    Args:
        name_or_path: 'paper_10x10', or 'my/site.yaml'.
        overrides: values by dotted path ('demand.cell_share', 'fleet.uavs.0.speed_mps'), which
            count more than the file's.

    Raises:
        ConfigError: one line per problem: file and line, key, value, what is allowed.
    """
    document = layers.load(name_or_path, scenario_folders(), field='scenario', overrides=overrides)
    return _checked(_with_sensors(_with_places(_with_fleet(document))))


def from_yaml(text: str) -> Scenario:
    """Read the text that `Scenario.to_yaml` wrote.

    Raises:
        ConfigError: one line per problem.
    """
    return _checked(layers.parse(text, label='scenario text', folder=Path()))


def from_file(path: Path) -> Scenario:
    """Read a file that `Scenario.to_yaml` was written to.

    Raises:
        ConfigError: one line per problem.
    """
    text = layers.read_text(path)
    return _checked(layers.parse(text, label=shown_path(path), folder=path.parent))


def parse_override(assignment: str) -> tuple[str, object]:
    """Read `demand.cell_share=0.5`, as given on a command line, into a path and a YAML value.

    Raises:
        ConfigError: there is no `=`, or what follows is not YAML.
    """
    path, equals, value = (part.strip() for part in assignment.partition('='))
    if not path or not equals:
        what = 'must be KEY=VALUE, as demand.cell_share=0.5'
        raise ConfigError(f'override: {shown(assignment)} {what}')
    try:
        return path, layers.parse_value(value)
    except ConfigError:
        what = f'is {shown(value)}: must be a YAML value'
        raise ConfigError(f'override: {shown_path(path)} {what}') from None


def with_uavs(scenario: Scenario, n_uavs: int) -> Scenario:
    """The scenario with another number of UAVs: those it has, in turn, and their faults."""
    uavs = tuple(islice(cycle(scenario.uavs), n_uavs))
    faults = scenario.faults and tuple(
        fault for fault in scenario.faults if fault.uav == 'any' or fault.uav <= n_uavs
    )
    return replace(scenario, fleet=FleetConfig(uavs=uavs), faults=faults or None)


def fingerprint(scenario: Scenario) -> str:
    """16 hex digits that change with any value of the scenario but its name and place on Earth.

    Missions are the same wherever that is.
    """
    values = scenario.as_mapping()
    del values['name']
    values['area'].pop('reference', None)
    canonical = json.dumps(values, sort_keys=True, separators=(',', ':'))
    return hashlib.sha256(canonical.encode()).hexdigest()[:16]


def scenario_names() -> tuple[str, ...]:
    """The names of the shipped scenarios."""
    return layers.names_in(scenario_folders())


def scenario_folders() -> tuple[Path, ...]:
    """Where shipped scenarios are: the checkout, or the share folder of an installation."""
    return shared_folders('scenarios')


def _with_fleet(document: Document) -> Document:
    """Each UAV with the keys of `fleet.default` that it does not set itself."""
    fleet = document.at(('fleet',))
    if not isinstance(fleet, dict):
        return document
    for key in fleet:
        if key not in ('default', 'uavs'):
            what = 'is an unknown key: must be one of default, uavs'
            raise ConfigError(document.problem(('fleet', key), what))
    default, uavs = fleet.get('default', {}), fleet.get('uavs')
    if isinstance(uavs, list | tuple) and len(uavs) > MAX_UAVS:
        what = f'has {len(uavs)} entries: must have at most {MAX_UAVS}'
        raise ConfigError(document.problem(('fleet', 'uavs'), what))
    if 'default' not in fleet:
        return document
    if not isinstance(default, dict):
        what = f'is {shown(default)}: must be a mapping of keys'
        raise ConfigError(document.problem(('fleet', 'default'), what))
    full = {key: value for key, value in fleet.items() if key != 'default'}
    aliases = {}
    if isinstance(uavs, list | tuple):
        full['uavs'] = [_over_default(default, uav) for uav in uavs]
        aliases = {
            ('fleet', 'uavs', index, *keys): ('fleet', 'default', *keys)
            for index, uav in enumerate(uavs)
            for keys in _inherited(default, uav)
        }
    return replace(document, values={**document.values, 'fleet': full}, aliases=aliases)


def _over_default(default: dict[Any, Any], uav: object) -> object:
    return layers.merged_mapping(default, uav) if isinstance(uav, dict) else uav


def _inherited(default: dict[Any, Any], uav: object) -> Iterator[Keys]:
    if isinstance(uav, dict):
        for key, value in default.items():
            if key not in uav:
                yield (key,)
            elif isinstance(value, dict) and isinstance(uav[key], dict):
                yield from ((key, *below) for below in _inherited(value, uav[key]))


def _with_places(document: Document) -> Document:
    """Each start and home given as a cell, as the cell's centre."""
    uavs = document.at(('fleet', 'uavs'))
    if not isinstance(uavs, list | tuple):
        return document
    area = validated(AreaConfig, document, ('area',))
    placed = []
    for index, uav in enumerate(uavs):
        places = {
            key: _place_of(document, ('fleet', 'uavs', index, key), area)
            for key in ('start', 'home')
            if isinstance(uav, dict) and key in uav
        }
        placed.append({**uav, **places} if places else uav)
    fleet = {**document.at(('fleet',)), 'uavs': placed}
    return replace(document, values={**document.values, 'fleet': fleet})


def _place_of(document: Document, keys: Keys, area: AreaConfig) -> dict[str, Any]:
    place: dict[str, Any] = document.at(keys)
    if isinstance(place, dict) and [*place] == ['position_m']:
        return place
    if not isinstance(place, dict) or [*place] != ['cell']:
        allowed = '{cell: [row, column]} or {position_m: [x, y]}'
        raise ConfigError(document.problem(keys, f'is {shown(place)}: must be {allowed}'))
    last = area.cells_per_side - 1
    rule = pair(whole(0, last), f'a list [row, column] of whole numbers from 0 to {last}')
    try:
        row, column = rule.parse(place['cell'])
    except ValueError:
        what = f'is {shown(place["cell"])}: must be {rule.allowed}'
        raise ConfigError(document.problem((*keys, 'cell'), what)) from None
    return {'position_m': ((column + 0.5) * area.cell_size_m, (row + 0.5) * area.cell_size_m)}


def _with_sensors(document: Document) -> Document:
    """The sensors of a CSV file in place of its name."""
    keys: Keys = ('sensors', 'kind')
    kind = document.at(keys)
    if isinstance(document.at(('sensors',)), dict) and kind not in ('drawn', 'csv', 'listed'):
        wrong = 'is missing' if kind is None else f'is {shown(kind)}'
        raise ConfigError(document.problem(keys, f'{wrong}: must be drawn, csv or listed'))
    if kind != 'csv':
        return document
    config = validated(CsvSensors, document, ('sensors',))
    area = validated(AreaConfig, document, ('area',))
    path = document.source(('sensors', 'file')).folder / config.file
    if not layers.is_file(path):
        what = f'is {shown(config.file)}: must be a CSV file, but there is no {shown_path(path)}'
        raise ConfigError(document.problem(('sensors', 'file'), what))
    origin = None if config.origin == 'auto' else config.origin
    read = sensor_files.read_sensors(path, origin=origin, side_m=area.side_m)
    values = {**document.values, 'sensors': {'kind': 'listed', 'entries': read.entries}}
    if read.reference is not None:
        if area.reference is not None:
            what = (
                f'is given: must be left out, as {shown_path(path)} gives latitudes and longitudes'
            )
            raise ConfigError(document.problem(('area', 'reference'), what))
        values['area'] = {**document.at(('area',)), 'reference': read.reference}
    return replace(document, values=values)


def _checked(document: Document) -> Scenario:
    """The scenario of a document that stands alone, its parts at peace with each other."""
    scenario = validated(Scenario, document)
    problems = [
        document.problem(keys, what)
        for wrong in (
            _wrong_uavs,
            _wrong_sensors,
            _too_many_sensors,
            _wrong_amounts,
            _wrong_delay,
            _wrong_faults,
        )
        for keys, what in wrong(scenario)
    ]
    if problems:
        raise ConfigError(*dict.fromkeys(problems))
    return scenario


def _wrong_uavs(scenario: Scenario) -> Iterator[tuple[Keys, str]]:
    area = scenario.area
    centres = {(i + 0.5) * area.cell_size_m for i in range(area.cells_per_side)}
    for index, uav in enumerate(scenario.uavs):
        keys: Keys = ('fleet', 'uavs', index)
        if not centres.issuperset(uav.start_m):
            what = f'is {shown(uav.start_m)}: must be the centre of a cell of the area'
            yield (*keys, 'start', 'position_m'), what
        if max(uav.home_m) > area.side_m:
            what = f'is {shown(uav.home_m)}: must be from 0 to {area.side_m:g} m'
            yield (*keys, 'home', 'position_m'), what
        if uav.energy_budget_kj <= uav.energy_margin_kj:
            margin = f'energy_margin_kj, {uav.energy_margin_kj:g} kJ'
            what = f'is {uav.energy_budget_kj:g}: must be more than {margin}'
            yield (*keys, 'energy_budget_kj'), what


def _wrong_sensors(scenario: Scenario) -> Iterator[tuple[Keys, str]]:
    if not isinstance(scenario.sensors, ListedSensors):
        return
    ids: set[str] = set()
    for index, sensor in enumerate(scenario.sensors.entries):
        keys: Keys = ('sensors', 'entries', index)
        if sensor.id in ids:
            yield (*keys, 'id'), f'is {shown(sensor.id)}: must be unique'
        ids.add(sensor.id)
        for key, value in (('x_m', sensor.x_m), ('y_m', sensor.y_m)):
            if value > scenario.area.side_m:
                yield (*keys, key), f'is {value:g}: must be from 0 to {scenario.area.side_m:g} m'


def _too_many_sensors(scenario: Scenario) -> Iterator[tuple[Keys, str]]:
    drawn = scenario.sensors
    if isinstance(drawn, ListedSensors):
        return
    n_dense = drawn.n_dense_cells(scenario.n_cells)
    n_sensors = {
        'dense_mean': n_dense * drawn.dense_mean,
        'sparse_mean': (scenario.n_cells - n_dense) * drawn.sparse_mean,
    }
    if sum(n_sensors.values()) > MAX_SENSORS:
        key = max(n_sensors, key=n_sensors.__getitem__)
        draws = f'the area has some {sum(n_sensors.values()):,.0f} sensors by it'
        what = f'is {getattr(drawn, key):g}: must be less, as {draws}, at most {MAX_SENSORS:,}'
        yield ('sensors', key), what


def _wrong_amounts(scenario: Scenario) -> Iterator[tuple[Keys, str]]:
    if scenario.demand.data_mbit != 'csv':
        return
    reason = 'the sensors are drawn'
    if isinstance(scenario.sensors, ListedSensors):
        amounts = {sensor.id: sensor.data_mbit for sensor in scenario.sensors.entries}
        without = [name for name, data_mbit in amounts.items() if data_mbit is None]
        if not without and any(amounts.values()):
            return
        reason = f'sensor {without[0]} has no data_mbit' if without else 'all data_mbit are 0'
    yield ('demand', 'data_mbit'), f'is csv: must be a list [low, high], as {reason}'


def _wrong_delay(scenario: Scenario) -> Iterator[tuple[Keys, str]]:
    mean_s, jitter_s = scenario.radio.delay_s or (0.0, 0.0)
    if jitter_s > mean_s:
        what = f'is {shown(scenario.radio.delay_s)}: the jitter must be at most the mean'
        yield ('radio', 'delay_s'), what


def _wrong_faults(scenario: Scenario) -> Iterator[tuple[Keys, str]]:
    for index, fault in enumerate(scenario.faults or ()):
        keys: Keys = ('faults', index)
        if fault.uav != 'any' and fault.uav > scenario.n_uavs:
            yield (*keys, 'uav'), f'is {fault.uav}: must be from 1 to {scenario.n_uavs}, or any'
        if (fault.at_s is None) == (fault.at_decision is None):
            yield keys, 'must have one of at_s and at_decision, and not both'
