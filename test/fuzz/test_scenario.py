"""Scenario files of any kind are refused in plain lines, or fly on finite numbers."""

from collections.abc import Iterator
import json
import math
from pathlib import Path
import re
import tempfile
from typing import Any

from fuzzing import fuzzed, memory_folder
from hypothesis import strategies as st
from hypothesis.strategies import DrawFn
import pytest
from scenario_texts import check_scenario, FLEET, texts, yaml_of
from tiny_world import tiny, uav
from uav_collect.config import layers
from uav_collect.config.rules import validated
from uav_collect.errors import ConfigError
from uav_collect.scenario.model import Scenario

_RADIO = {
    'loss_share': 0.3, 'delay_s': [2.0, 1.0], 'rate_bps': 1200.0, 'beacon_period_s': 5.0
}  # fmt: skip
_DRAWN = {
    'kind': 'drawn', 'seed': 3, 'dense_cell_share': 0.3, 'dense_mean': 3.0, 'sparse_mean': 1.0
}  # fmt: skip
_FAULTS = [
    {'uav': 'any', 'kind': 'gone', 'at_s': [0, 50], 'share': 0.5},
    {'uav': 1, 'kind': 'slow', 'at_decision': 2},
    {'uav': 2, 'kind': 'silent', 'at_s': 10.0},
]
_REFERENCE = {'lat_deg': 55.0, 'lon_deg': 12.8, 'position_m': [100.0, 100.0]}
_PLACES = (
    'position_m', 'x_m', 'y_m', 'cell.', 'cells_per_side', 'rows', 'columns', 'boundary', 'no_fly',
)  # fmt: skip
_SPAN = re.compile(r'from ([-+.e\d]+) to ([-+.e\d]+)')


_OUTLINES: dict[str, object] = {
    'area__boundary': [[0, 0], [250, 0], [250, 120], [100, 150], [0, 150]],
    'area__no_fly': [[[60, 60], [140, 60], [140, 90]]],
}


def _documents() -> list[dict[str, Any]]:
    alone = uav(5.0, energy_budget_kj=9.0)
    scenarios = (
        tiny(*FLEET),
        tiny(alone, sensors=((1, 2, 1),), area__cells_per_side=1),
        tiny(*FLEET, sensors=((1, 2, 1),), area__rows=3, area__columns=5, **_OUTLINES),
    )
    whole, single, odd = (json.loads(json.dumps(it.as_mapping())) for it in scenarios)
    for unit in (*whole['fleet']['uavs'], *single['fleet']['uavs'], *odd['fleet']['uavs']):
        unit |= {'start': {'cell': [0, 0]}, 'home': {'cell': [0, 0]}}
    return [
        whole,
        whole | {'sensors': _DRAWN, 'demand': {'cell_share': 0.3, 'data_mbit': [0.1, 1.0]}},
        whole | {'radio': whole['radio'] | _RADIO},
        whole | {'faults': _FAULTS, 'area': whole['area'] | {'reference': _REFERENCE}},
        single,
        odd,
    ]


DOCUMENTS = _documents()


@pytest.fixture(scope='module')
def folder() -> Iterator[Path]:
    with tempfile.TemporaryDirectory(dir=memory_folder('scenario')) as name:
        folder = Path(name)
        (folder / 'base.yaml').write_bytes(b'extends: paper_8x8\nname: base\n')
        for document in DOCUMENTS:  # kernels compile before tries are timed
            (folder / 'scenario.yaml').write_bytes(yaml_of(document))
            check_scenario(folder / 'scenario.yaml')
        yield folder


@fuzzed(share=0.75, content=texts(DOCUMENTS))
def test_a_scenario_is_refused_in_plain_lines_or_flies_on_finite_numbers(
    folder: Path, content: bytes
) -> None:
    path = folder / 'scenario.yaml'
    path.write_bytes(content)
    check_scenario(path)


def _numbers(value: object, path: str = '') -> Iterator[str]:
    """The paths of numbers that may be at the ends of their ranges without the others moving."""
    if isinstance(value, dict | list):
        pairs = value.items() if isinstance(value, dict) else enumerate(value)
        for key, part in pairs:
            yield from _numbers(part, f'{path}.{key}'.lstrip('.'))
    elif isinstance(value, int | float) and not any(key in path for key in _PLACES):
        yield path


def _ends(document: dict[str, Any]) -> dict[str, tuple[float, float]]:
    """The least and the largest value of each number, as the line says that refuses another."""
    parsed, ends = layers.of_mapping(document, label=''), {}
    for path in _numbers(document):
        with pytest.raises(ConfigError) as caught:
            validated(Scenario, layers.override(parsed, {path: 'x'}))
        [problem] = [line for line in caught.value.problems if "'x'" in line]
        if (span := _SPAN.search(problem)) is not None:
            low, high = map(float, span.groups())
            ends[path] = (low, high)
    return ends


ENDS = [_ends(document) for document in DOCUMENTS]


@st.composite
def at_ends(draw: DrawFn) -> bytes:
    """A file with some numbers at the ends of their ranges, or a bit beyond them."""
    which = draw(st.integers(0, len(DOCUMENTS) - 1))
    document = json.loads(json.dumps(DOCUMENTS[which]))
    moved = st.dictionaries(st.sampled_from([*ENDS[which]]), st.integers(0, 23), max_size=8)
    for path, end in draw(moved).items():
        *way, last = (int(key) if key.isdecimal() else key for key in path.split('.'))
        parent = document
        for key in way:
            parent = parent[key]
        low, high = ENDS[which][path]
        beyond = (math.nextafter(low, -math.inf), math.nextafter(high, math.inf))
        number = beyond[end] if end < 2 else (low, high)[end % 2]
        parent[last] = int(number) if isinstance(parent[last], int) else number
    return yaml_of(document)


@fuzzed(share=0.25, content=at_ends())
def test_at_the_ends_of_all_ranges_everything_is_finite(folder: Path, content: bytes) -> None:
    path = folder / 'scenario.yaml'
    path.write_bytes(content)
    check_scenario(path)


def test_the_ends_of_ranges_are_known_of_most_numbers() -> None:
    assert {'area.cell_size_m', 'radio.nlos_attenuation', 'demand.data_mbit.0'} <= {*ENDS[1]}
    assert sum(map(len, ENDS)) > 150
