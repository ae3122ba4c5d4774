"""Measures how the package is built, and says where a limit is broken.

`python tools/structure.py` is part of `make check`. Rooms are the modules and sub-packages at the
package's root; imports count wherever they stand, in functions and for type checkers alone, too.
What one decision runs through is traced in flight. `--package` measures a checkout elsewhere.
"""

import argparse
import ast
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cache
import os
from pathlib import Path
import sys
from textwrap import fill
from types import CodeType, FrameType
from typing import Any

PACKAGE = Path(__file__).resolve().parents[1] / 'uav_collect'
NAME = PACKAGE.name

# Rooms from the ground up: each imports only from those before it. `__init__` is the public face.
ORDER = (
    *('errors', 'files', 'limits', 'revision', 'kernels', 'config', 'physics', 'scenario', 'uav'),
    *('recording', 'world', 'lockstep', 'missions', 'planning', 'ingest', 'analysis', 'fields'),
    *('training', 'handover', 'environments', 'api', '__init__', 'film', 'learning', 'nodes'),
    *('studies', 'commands', '__main__'),
)
MAX_ROOT_MODULES = 8
MAX_FLOORS = 13
MAX_DECISION_FILES = 12

_COLUMNS = 99
_SCENARIO = 'paper_10x10'
_LEARNED = 'paper_10x10_n2_aqmix'
_DONE = ('batch_kernels', 'carry_out')  # module and function that end a decision

Sources = Mapping[str, str]  # texts by path in the package
Graph = dict[str, set[str]]  # what each one imports


@dataclass(frozen=True, kw_only=True)
class Row:
    """A number of the table, what it may be at most, and what it counts."""

    title: str
    value: int
    limit: int | None = None
    names: tuple[str, ...] = ()

    @property
    def is_broken(self) -> bool:
        """Whether the number is above its limit."""
        return self.limit is not None and self.value > self.limit


def read(package: Path = PACKAGE) -> dict[str, str]:
    """The sources of a package by their path in it."""
    paths = sorted(package.rglob('*.py'))
    return {path.relative_to(package).as_posix(): path.read_text() for path in paths}


def module_of(path: str) -> str:
    """A module's dotted name below the package; that of a sub-package for its `__init__.py`."""
    return path.removesuffix('.py').removesuffix('/__init__').replace('/', '.')


@cache
def imported(source: str) -> frozenset[str]:
    """All that a source imports anywhere, dotted; what is taken out of a module with its name."""
    found = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            found.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            found.update(f'{node.module}.{alias.name}' for alias in node.names)
    return frozenset(found)


def module_graph(sources: Sources) -> Graph:
    """Which modules of the package each one imports."""
    modules = {module_of(path) for path in sources}

    def own(name: str) -> Iterable[str]:
        package, _, inside = name.partition('.')
        if package != NAME:
            return
        # `from uav_collect.uav import actions` names a module, `... import Agent` a part of one.
        above = inside.rpartition('.')[0]
        yield next((each for each in (inside, above) if each in modules), '__init__')

    return {
        module_of(path): {to for name in imported(source) for to in own(name)} - {module_of(path)}
        for path, source in sources.items()
    }


def room_of(module: str) -> str:
    """The room that a module stands in."""
    return module.partition('.')[0]


def room_graph(modules: Graph) -> Graph:
    """Which rooms each one imports."""
    rooms: Graph = {}
    for module, others in modules.items():
        rooms.setdefault(room_of(module), set()).update(map(room_of, others))
    return {room: others - {room} for room, others in rooms.items()}


def circles(graph: Graph) -> list[tuple[str, ...]]:
    """Groups of which each one imports, by way of others, each other."""
    reached = {one: _reached(graph, one) for one in graph}
    groups = {
        tuple(sorted(other for other in reached[one] if one in reached[other]))
        for one in graph
        if one in reached[one]
    }
    return sorted(groups)


def _reached(graph: Graph, start: str) -> set[str]:
    found: set[str] = set()
    waiting = [*graph[start]]
    while waiting:
        one = waiting.pop()
        if one not in found:
            found.add(one)
            waiting += graph[one]
    return found


def longest_chain(graph: Graph) -> tuple[str, ...]:
    """The longest chain of imports, from the top down; of a circle, one stands for all."""
    group_of = {one: group for group in circles(graph) for one in group}
    chains: dict[str, tuple[str, ...]] = {}

    def chain(one: str) -> tuple[str, ...]:
        if one not in chains:
            group = group_of.get(one, (one,))
            below = {other for each in group for other in graph[each]} - {*group}
            longest = max((chain(other) for other in sorted(below)), key=len, default=())
            chains.update((each, (each, *longest)) for each in group)
        return chains[one]

    return max(map(chain, sorted(graph)), key=len)


def upward(modules: Graph, order: tuple[str, ...] = ORDER) -> list[str]:
    """Imports against the order of rooms, and rooms that have no place in it."""
    place = {room: index for index, room in enumerate(order)}
    lost = sorted({*map(room_of, modules)} - {*place})
    against = [
        f'{module}->{other}'
        for module, others in sorted(modules.items())
        for other in sorted(others)
        if place.get(room_of(other), -1) > place.get(room_of(module), len(order))
    ]
    return [*(f'{room} has no place' for room in lost), *against]


def import_rows(sources: Sources) -> list[Row]:
    """What the sources alone tell."""
    modules = module_graph(sources)
    rooms = room_graph(modules)
    root = [path for path in sources if '/' not in path]
    n_lines = {path: source.count('\n') for path, source in sources.items()}
    longest = max(n_lines, key=lambda path: n_lines[path])
    chain, knots, loops = longest_chain(rooms), circles(rooms), circles(modules)
    against = upward(modules)
    return [
        Row(title='modules', value=len(modules)),
        Row(title="at the package's root", value=len(root), limit=MAX_ROOT_MODULES),
        Row(title='rooms', value=len(rooms)),
        Row(title='floors', value=len(chain), limit=MAX_FLOORS, names=chain),
        Row(title='circles of rooms', value=len(knots), limit=0, names=(*map('<->'.join, knots),)),
        Row(title='of modules', value=len(loops), limit=0, names=(*map('<->'.join, loops),)),
        Row(title='imports upward', value=len(against), limit=0, names=(*against,)),
        Row(title='longest module', value=n_lines[longest], names=(longest,)),
        Row(title='source lines', value=sum(n_lines.values())),
    ]


class Tracer:
    """Notes the files that run from the end of one decision to the end of the next.

    All decisions of a flight count but the first; what runs after the last one does not.
    """

    def __init__(self, package: Path) -> None:
        self.files: set[str] = set()
        self._package = f'{package}{os.sep}'
        self._running: set[str] | None = None  # None before the first decision

    def trace(self, fly: Callable[[], object]) -> tuple[str, ...]:
        """The modules that decisions of a flight run through."""
        fly()  # what is imported or kept at the first time is no part of a decision
        sys.settrace(self._called)
        try:
            fly()
        finally:
            sys.settrace(None)
        if not self.files:
            raise SystemExit(f'{".".join(_DONE)} was not called: what else ends a decision?')
        return tuple(sorted(module_of(file) for file in self.files))

    def _called(self, frame: FrameType, event: str, argument: object) -> Any:  # noqa: ANN401
        code = frame.f_code
        return self._ran if code.co_filename.startswith(self._package) else None

    def _ran(self, frame: FrameType, event: str, argument: object) -> Any:  # noqa: ANN401
        code = frame.f_code
        if self._running is not None:
            self._running.add(code.co_filename.removeprefix(self._package))
        if event == 'return' and _ends_decision(code):
            self.files |= self._running or set()
            self._running = set()
        return self._ran


def _ends_decision(code: CodeType) -> bool:
    return (Path(code.co_filename).stem, code.co_name) == _DONE


def flight_rows(package: Path) -> list[Row]:
    """What decisions run through, by how they are flown."""
    os.environ['UAV_COLLECT_KERNELS'] = 'interpreted'  # or else nothing could be traced
    sys.path.insert(0, str(package.parent))
    from uav_collect.limits import GUARD_AFTER
    from uav_collect.missions.rollout import fly
    from uav_collect.missions.simulation import fly_by_agents
    from uav_collect.scenario.load import load
    from uav_collect.scenario.site import build_site
    from uav_collect.uav.policy import policy_for

    scenario = load(_SCENARIO)
    site = build_site(scenario)
    flown = {
        'by a rule': lambda: fly(site, [0], 'sweep'),
        'by a learned policy': lambda: fly(site, [0], _LEARNED),
        'a rule, agent by agent': lambda: _by_agents('sweep'),
        'learned, by agents': lambda: _by_agents(_LEARNED),
    }

    def _by_agents(policy: str) -> object:
        return fly_by_agents(site, 0, lambda: policy_for(policy, scenario), 'exact', GUARD_AFTER)

    rows = []
    for title, flight in flown.items():
        names = Tracer(package).trace(flight)
        rows.append(Row(title=title, value=len(names), limit=MAX_DECISION_FILES, names=names))
    return rows


def main() -> int:
    """Print the tables; 1 if a limit is broken."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--package', type=Path, default=PACKAGE, help='the folder uav_collect')
    package = parser.parse_args().package.resolve()
    rows = import_rows(read(package))
    print(f'structure of {NAME}')
    _show(rows)
    flights = flight_rows(package)
    print('files that one decision runs through')
    _show(flights)
    broken = [row for row in (*rows, *flights) if row.is_broken]
    for row in broken:
        print(f'error: {row.title}: {row.value}, must be at most {row.limit}', file=sys.stderr)
    return 1 if broken else 0


def _show(rows: Iterable[Row]) -> None:
    for row in rows:
        limit = '' if row.limit is None else f'at most {row.limit}'
        start = f'  {row.title:22}{row.value:6}  {limit:12}'
        print(
            fill('  '.join(row.names), _COLUMNS, initial_indent=start, subsequent_indent=' ' * 42)
            or start.rstrip()
        )


if __name__ == '__main__':
    raise SystemExit(main())
