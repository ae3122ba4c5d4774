"""Scenarios that are nearly right, as text, and what must be true of each that is accepted."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
import json
import math
from pathlib import Path
from typing import Any

from fuzzing import check_lines
from hypothesis import strategies as st
from hypothesis.strategies import DrawFn, SearchStrategy
import numpy as np
from tiny_world import uav
from uav_collect.errors import ConfigError
from uav_collect.missions.rollout import fly
from uav_collect.missions.vector_env import VectorEnv, VectorEnvConfig
from uav_collect.recording.mission_log import EVENT_DTYPE
from uav_collect.scenario.load import fingerprint, from_yaml, load
from uav_collect.scenario.model import Scenario
from uav_collect.scenario.site import build_site, Site
from uav_collect.uav.action_codes import NONE
from uav_collect.uav.actions import check_can_start, home_energy_j, move_duration_s
from uav_collect.uav.briefing import brief, Briefing
from uav_collect.world.reward import Reward, reward_terms
from uav_collect.world.sensor_field import demand_of, lay_out

_MAX_SENSORS = 300  # of a site that is flown over, and
_MAX_MOVES = 300  # moves that its fleet has the energy for,
_MAX_BEACONS = 1000  # and beacons that it sends: others take longer than a try may
_N_STEPS = 8  # of a mission that is flown by random actions
_FLOATS = [name for name in EVENT_DTYPE.names or () if EVENT_DTYPE[name].kind == 'f']

FLEET = (uav(5.0, energy_budget_kj=9.0), uav(10.0, energy_budget_kj=5.0))

_NUMBERS = (
    0, 1, 2, 3, 63, 64, 65, 100, 1000, 20_000, 10**6, 10**9, 2**62, 2**63 - 1, 2**63, 10**40,
    10**400, 0.0, 5e-324, 1e-310, 2.3e-308, 1e-200, 1e-160, 1e-16, 1e-9, 1e-6, 1e-3, 0.01, 0.1,
    0.5, 0.999999, 1.0, 1.5, 30.0, 90.0, 9999.9, 1e4, 1e5, 1e6, 3e11, 1e12, 1e100, 1e300, 1.7e308,
    math.inf, math.nan,
)  # fmt: skip
_RAW = (
    '', '~', '!!int ""', '!!int 5', '!!bool x', '!!float _', '!!map [1]', '!!timestamp x',
    '!!set x', '!!binary "="', '!!omap x', '!!python/name:os.system', '!x 1', '! 1', '&a [*a]',
    '&a {b: *a}', '*nothing', '{<<: {a: 1}}', '{<<: 1}', '0x1f', '0o17', '017', '1_000', '1:30',
    '1e5', '1.e+5', '2024-01-01', '=', '<<', 'yes', 'Off', '[[[[[[[]]]]]]]', '[', '}', '"', "'",
    '|', '>-\n  a', '%', '@', '`', '{a: 1, a: 2}', '{? [a] : b}', '[&x 1, *x]', '"a\\nb"',
    '"\\ud800"', '"\\0"', '- 1', 'a: b', '#', '\t1', '\u2028', '\x85', '\x07', '\ufeff', '1 m',
    '50,0', '1' * 1001, '0.' + '1' * 999, f'[{"[" * 60}', f'[{"1," * 300}1]',
)  # fmt: skip
_TEXTS = (
    'any', 'all', 'csv', 'auto', 'drawn', 'listed', 'gone', 'slow', '../../outside', 'a[/b]', '.',
    '..', '', ' ', '\u00d6', 'x' * 70, 'x' * 5000, '\x00', '\x1b[2J', 'S1', '.inf', '5',
)  # fmt: skip
_KEYS = (
    'extends', 'name', 'area', 'default', 'uavs', 'kind', 'seed', 'cell', 'position_m',
    'reference', 'lat_deg', 'origin', 'file', 'loss_share', 'at_s', 'at_decision', 'share', '',
    'k' * 300, '5',
)  # fmt: skip
_HEADS = (
    b'extends: paper_10x10\n', b'extends: paper_8x8\n',
    b'extends: rough_10x10\n', b'extends: lillgrund\n', b'extends: ./scenario.yaml\n',
    b'extends: base.yaml\n', b'extends: ../../x.yaml\n', b'extends: nothing\n', b'extends: [a]\n',
    b'%YAML 1.2\n---\n', b'\xef\xbb\xbf', b'\xff\xfe', b'--- a\n---\n', b'x: &x [1, 2]\n',
)  # fmt: skip


_BYTES = (
    *(bytes([byte]) for byte in range(32, 128)),
    b'', b'', b'\n', b'\r', b'\t', b'\n  ', b': ', b', ', b'\x00', b'\x1b', b'\xff', b'\xc3\x96',
    b'1e', b'-0.',
)  # fmt: skip


class Raw(str):
    """Text of a document that stands there as it is."""

    __slots__ = ()


@dataclass(frozen=True)
class Change:
    """What is done to one part of a document."""

    place: int  # running number of the part, modulo how many there are
    how: str
    value: Any
    key: str


def values() -> SearchStrategy[Any]:
    """What may stand where a value does."""
    leaves = (
        st.sampled_from(_NUMBERS)
        | st.sampled_from(_NUMBERS).map(lambda number: -number)
        | st.floats()
        | st.integers(-5, 70)
        | st.sampled_from(_RAW).map(Raw)
        | st.sampled_from(_TEXTS)
        | st.text(max_size=5)
        | st.none()
        | st.booleans()
    )
    pairs = st.lists(leaves, max_size=3)
    return leaves | pairs | st.dictionaries(st.sampled_from(_KEYS), leaves, max_size=2)


def changes() -> SearchStrategy[Change]:
    """What may be done to a document."""
    return st.builds(
        Change,
        place=st.integers(0, 10**6),
        how=st.sampled_from(['set', 'set', 'set', 'set', 'drop', 'add', 'twice', 'swap']),
        value=values(),
        key=st.sampled_from(_KEYS),
    )


def changed(document: Mapping[str, Any], all_changes: list[Change]) -> dict[str, Any]:
    """A copy of a document with changes."""
    copy: dict[str, Any] = json.loads(json.dumps(document))
    for change in all_changes:
        parts = [*_parts(copy)]
        if parts:
            _change(*parts[change.place % len(parts)], change)
    return copy


def _parts(value: dict[Any, Any] | list[Any]) -> Iterator[tuple[Any, Any]]:
    """Each part of a value: what it stands in, and by which key or index."""
    pairs = value.items() if isinstance(value, dict) else enumerate(value)
    for key, part in pairs:
        yield value, key
        if isinstance(part, dict | list):
            yield from _parts(part)


def _change(parent: Any, key: Any, change: Change) -> None:  # noqa: ANN401
    part = parent[key]
    match change.how:
        case 'set':
            parent[key] = change.value
        case 'drop':
            del parent[key]
        case 'add' if isinstance(part, dict):
            part[change.key] = change.value
        case 'twice' if isinstance(parent, list):
            parent.append(part)
        case _:
            parent[key] = [part] if change.place % 2 else {change.key: part}


def yaml_of(document: Mapping[str, Any]) -> bytes:
    """A document as YAML, each of its sections on a line of its own."""
    lines = [f'{_flow(key)}: {_flow(part)}' for key, part in document.items()]
    return '\n'.join(lines).encode('utf-8', 'surrogatepass')


def _flow(value: object) -> str:
    if isinstance(value, Raw):
        return str(value)
    if isinstance(value, dict):
        pairs = ', '.join(f'{_flow(key)}: {_flow(part)}' for key, part in value.items())
        return f'{{{pairs}}}'
    if isinstance(value, list | tuple):
        return f'[{", ".join(map(_flow, value))}]'
    if isinstance(value, float) and not math.isfinite(value):
        return {'nan': '.nan', 'inf': '.inf', '-inf': '-.inf'}[str(value)]
    return json.dumps(value)


@st.composite
def texts(draw: DrawFn, documents: list[dict[str, Any]]) -> bytes:
    """A file: a document that is changed here and there, and some of its bytes as well."""
    document = changed(draw(st.sampled_from(documents)), draw(st.lists(changes(), max_size=4)))
    content = yaml_of(document)
    if draw(st.integers(0, 4)) == 0:
        content = draw(st.sampled_from(_HEADS)) + content
    if draw(st.integers(0, 4)) == 0:
        content = draw(broken(content))
    return content


@st.composite
def broken(draw: DrawFn, content: bytes) -> bytes:
    """A content with some of its bytes changed, lost or more."""
    for _ in range(draw(st.integers(1, 3))):
        start = draw(st.integers(0, len(content)))
        stop = start + draw(st.sampled_from([0, 0, 1, 1, 2, 7, 300]))
        content = content[:start] + draw(st.sampled_from(_BYTES)) + content[stop:]
    return content


def check_scenario(path: Path) -> None:
    """Hold what comes of a file to the claim: plain lines, or numbers through and through."""
    try:
        scenario = load(path)
        site, briefing = build_site(scenario), brief(scenario)
        check_can_start(scenario, briefing)
    except ConfigError as error:
        check_lines(str(error).splitlines())
        for line in error.problems:
            is_named = (
                '.yaml' in line or '.csv' in line or line.startswith(('scenario ', 'sensors'))
            )
            assert is_named, line
        return
    read_again = from_yaml(scenario.to_yaml())
    assert fingerprint(read_again) == fingerprint(scenario)
    check_derived(scenario, site, briefing)
    check_flight(site, briefing)


def check_derived(scenario: Scenario, site: Site, briefing: Briefing) -> None:
    """All that follows from a scenario before anything flies is finite, and has its sign."""
    for name, value in briefing._asdict().items():
        if name not in ('contact_range_m', 'home_via'):
            assert np.isfinite(value).all(), name
            assert (np.asarray(value) >= 0).all(), name
    for name in ('cell_size_m', 'speed_mps', 'flight_power_w', 'hover_power_w', 'bandwidth_hz'):
        assert (np.asarray(getattr(briefing, name)) > 0).all(), name
    for unit in range(briefing.n_uavs):
        assert 0 < move_duration_s(briefing, unit) < math.inf
        for cell in (0, scenario.n_cells - 1):
            x_m = (cell % briefing.n_columns + 0.5) * briefing.cell_size_m
            y_m = (cell // briefing.n_columns + 0.5) * briefing.cell_size_m
            assert 0 <= home_energy_j(briefing, unit, x_m, y_m) < math.inf
    assert np.isfinite(site.position_m).all()
    assert (site.cell >= 0).all()
    assert (site.cell < scenario.n_cells).all()
    field = lay_out(site)
    for name in ('los_probability', 'path_gain', 'rician_factor'):
        row = np.asarray(getattr(field, name))
        assert np.isfinite(row).all(), name
        assert (row >= 0).all(), name
    assert (np.asarray(field.path_gain) > 0).all()
    assert np.isfinite([value for value in reward_terms(site)[:4]]).all()
    demand_bit = demand_of(site, 7)
    assert np.isfinite(demand_bit).all()
    assert (demand_bit >= 0).all()


def check_flight(site: Site, briefing: Briefing) -> None:
    """A mission's log and rewards are finite, where it is short enough to be flown."""
    if site.n_sensors > _MAX_SENSORS or not _is_short(site.scenario, briefing):
        return
    for reward in (Reward.PAPER, Reward.ENERGY):
        env = VectorEnv(site, [3], VectorEnvConfig(reward=reward, layout=None))
        for step in range(_N_STEPS):
            waiting = env.decisions
            assert np.isfinite([*waiting.reward, *waiting.duration_s, *waiting.time_s]).all()
            if waiting.uav[0] == NONE:
                break
            legal = np.flatnonzero(waiting.legal[0])
            env.step(legal[[step % len(legal)]])
    [log] = fly(site, [5], 'hert')
    for name in _FLOATS:
        assert np.isfinite(log.events[name]).all(), name


def _is_short(scenario: Scenario, briefing: Briefing) -> bool:
    n_moves = n_beacons = 0.0
    for unit in range(briefing.n_uavs):
        least_w = min(briefing.flight_power_w[unit], briefing.hover_power_w[unit])
        aloft_s = briefing.energy_budget_j[unit] / least_w
        n_moves += aloft_s / move_duration_s(briefing, unit)
        n_beacons += aloft_s / (scenario.radio.beacon_period_s or math.inf)
    return n_moves <= _MAX_MOVES and n_beacons <= _MAX_BEACONS
