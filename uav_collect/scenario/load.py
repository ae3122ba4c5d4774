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
from typing import Any, TYPE_CHECKING

from uav_collect.config import layers
from uav_collect.config.installed import shared_folders
from uav_collect.config.layers import Document
from uav_collect.config.rules import validated
from uav_collect.config.yaml_text import Keys, shown, shown_path
from uav_collect.errors import ConfigError
from uav_collect.limits import MAX_SENSORS, MAX_UAVS
from uav_collect.scenario.airframes import WAYS, with_airframes
from uav_collect.scenario.model import (
    AreaConfig,
    CsvSensors,
    FleetConfig,
    ListedSensors,
    Scenario,
)
from uav_collect.scenario.named_cells import area_of, row_and_column, with_zones_of_cells
from uav_collect.scenario.rounding import without_rounding

if TYPE_CHECKING:
    from uav_collect.scenario.plane import OnArea

# To say how many cells an area has.
_AREA_WAYS = frozenset({'cells_per_side'}), frozenset({'rows', 'columns'})


def load(name_or_path: str | Path, overrides: Mapping[str, object] | None = None) -> Scenario:
    """Read a scenario by its name among the shipped ones, or by the path of a YAML file.

    Args:
        name_or_path: 'paper_10x10', or 'my/site.yaml'.
        overrides: values by dotted path ('demand.cell_share', 'fleet.uavs.0.speed_mps'), which
            count more than the file's.

    Raises:
        ConfigError: one line per problem: file and line, key, value, what is allowed.
    """
    document = layers.load(
        name_or_path,
        scenario_folders(),
        field='scenario',
        overrides=overrides,
        ways=(*WAYS, _AREA_WAYS),
    )
    placed = _with_places(with_zones_of_cells(with_airframes(_with_fleet(document))))
    return _checked(_with_known_empty(_with_sensors(placed)))


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
    """16 hex digits that change with any value of the scenario that missions depend on.

    They are the same by any name, wherever on Earth, whatever battery the energy comes from.
    """
    values = scenario.as_mapping()
    del values['name']
    for key in ('reference', 'crs'):
        values['area'].pop(key, None)
    for uav in values['fleet']['uavs']:
        uav.pop('battery', None)
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
    return layers.merged_mapping(default, uav, WAYS) if isinstance(uav, dict) else uav


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
    area = area_of(document)
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
    row, column = row_and_column(document, (*keys, 'cell'), place['cell'], area)
    return {'position_m': ((column + 0.5) * area.cell_size_m, (row + 0.5) * area.cell_size_m)}


def _with_sensors(document: Document) -> Document:
    """The sensors of a list in place of its name."""
    keys: Keys = ('sensors', 'kind')
    kind = document.at(keys)
    if isinstance(document.at(('sensors',)), dict) and kind not in ('drawn', 'csv', 'listed'):
        wrong = 'is missing' if kind is None else f'is {shown(kind)}'
        raise ConfigError(document.problem(keys, f'{wrong}: must be drawn, csv or listed'))
    if kind != 'csv':
        return document
    config = validated(CsvSensors, document, ('sensors',))
    area = area_of(document)
    path = document.source(('sensors', 'file')).folder / config.file
    if not layers.is_file(path):
        there = f'but there is no {shown_path(path)}'
        what = f'is {shown(config.file)}: must be a list of sensors, {there}'
        raise ConfigError(document.problem(('sensors', 'file'), what))
    needs_data = document.at(('demand', 'data_mbit')) == 'csv'
    read = _read_list(path, config, area, needs_data=needs_data)
    if problems := [document.problem(*it) for it in _said_twice(area, read, shown_path(path))]:
        raise ConfigError(*problems)
    read_area = {
        'boundary': read.boundary,
        'no_fly': (*(area.no_fly or ()), *read.no_fly) or None,
        'reference': read.reference,
        'crs': read.crs,
    }
    values = {
        **document.values,
        'area': document.at(('area',)) | {key: it for key, it in read_area.items() if it},
        'sensors': {'kind': 'listed', 'entries': read.entries},
    }
    return replace(document, values=values)


def _said_twice(area: AreaConfig, read: 'OnArea', path: str) -> Iterator[tuple[Keys, str]]:
    """What both the scenario and its list of sensors say, but zones: these are joined."""
    for key, by_list, what in (
        ('reference', read.reference, 'latitudes and longitudes'),
        ('boundary', read.boundary, 'the boundary'),
        ('crs', read.crs, 'the grid'),
    ):
        if by_list is not None and getattr(area, key) not in (None, by_list):
            yield ('area', key), f'is given: must be left out, as {path} gives {what}'


def _with_known_empty(document: Document) -> Document:
    """Whether it is known which cells hold no data: as it is where sensors are listed.

    Only here: what was written before there was such a key is flown as it was.
    """
    demand, kind = document.at(('demand',)), document.at(('sensors', 'kind'))
    if not isinstance(demand, dict):
        return document
    known = demand.get('known_empty')
    if kind == 'listed' and known is None:
        known = 'sensors'
    elif kind == 'drawn' and known == 'none':
        known = None  # as where nothing is said
    return replace(
        document, values={**document.values, 'demand': {**demand, 'known_empty': known}}
    )


def _read_list(path: Path, config: CsvSensors, area: AreaConfig, *, needs_data: bool) -> 'OnArea':
    """What a list says of the sensors on an area."""
    from uav_collect.scenario import places, plane  # agents load none of it

    options = places.ReadOptions(
        columns=config.columns or {},
        crs=config.crs or '',
        doubles=config.doubles or 'refuse',
        skips_blanks=config.blanks == 'skip',
        needs_data=needs_data,
    )
    return plane.on_area(
        places.read(path, options),
        origin=None if config.origin == 'auto' else config.origin,
        width_m=area.width_m,
        height_m=area.height_m,
    )


def _checked(document: Document) -> Scenario:
    """The scenario of a document that stands alone, its parts at peace with each other."""
    as_written = validated(Scenario, document)
    area_of(document)
    scenario = without_rounding(as_written)
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
    if not problems and (scenario.area.boundary or scenario.area.no_fly):
        from uav_collect.scenario.cut_off import wrong_closed_cells  # loads numpy

        problems = [document.problem(*it) for it in wrong_closed_cells(scenario)]
    if problems:
        raise ConfigError(*dict.fromkeys(problems))
    return scenario


def _wrong_uavs(scenario: Scenario) -> Iterator[tuple[Keys, str]]:
    area = scenario.area
    x_m, y_m = (
        {(i + 0.5) * area.cell_size_m for i in range(n)} for n in (area.n_columns, area.n_rows)
    )
    for index, uav in enumerate(scenario.uavs):
        keys: Keys = ('fleet', 'uavs', index)
        if uav.start_m[0] not in x_m or uav.start_m[1] not in y_m:
            what = f'is {shown(uav.start_m)}: must be the centre of a cell of the area'
            yield (*keys, 'start', 'position_m'), what
        if uav.home_m[0] > area.width_m or uav.home_m[1] > area.height_m:
            allowed = f'from 0 to {area.width_m:.10g} m'
            if area.height_m != area.width_m:
                allowed = f'x {allowed}, y from 0 to {area.height_m:.10g} m'
            what = f'is {shown(uav.home_m)}: must be {allowed}'
            yield (*keys, 'home', 'position_m'), what
        if uav.energy_budget_kj <= uav.energy_margin_kj:
            margin = f'energy_margin_kj, {uav.energy_margin_kj:g} kJ'
            what = f'is {uav.energy_budget_kj:g} kJ: must be more than {margin}'
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
        area = scenario.area
        for key, value, most_m in (
            ('x_m', sensor.x_m, area.width_m),
            ('y_m', sensor.y_m, area.height_m),
        ):
            if value > most_m:
                yield (*keys, key), f'is {value:.10g}: must be from 0 to {most_m:.10g} m'


def _too_many_sensors(scenario: Scenario) -> Iterator[tuple[Keys, str]]:
    drawn = scenario.sensors
    if isinstance(drawn, ListedSensors):
        return
    n_open = scenario.n_cells
    if scenario.area.boundary or scenario.area.no_fly:
        from uav_collect.scenario.area import open_cells  # loads numpy

        n_open = int(open_cells(scenario.area).sum())
    n_dense = drawn.n_dense_cells(n_open)
    n_sensors = {
        'dense_mean': n_dense * drawn.dense_mean,
        'sparse_mean': (n_open - n_dense) * drawn.sparse_mean,
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
