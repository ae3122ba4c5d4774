"""The parts of the reference that docs/ does not hold: each is made of its one source.

`GENERATED` has them by the names that pages ask for them by, as `<!-- generated: topics -->`. Some
stand in the pages, too, up to `<!-- end -->`, for those who read the sources: `python -m
tools.pages.reference` writes them there anew, which `make docs` does before it builds the site.
"""

import argparse
from collections.abc import Callable, Iterable, Iterator
from html import escape
from importlib import import_module
import os
from pathlib import Path
import re
from typing import Any, NamedTuple

import uav_collect
from uav_collect.__main__ import command_named, SUMMARIES
import yaml

from tools import structure

ROOT = Path(__file__).parents[2]
INTERFACES = ROOT / 'msg_defs'
TOPIC_NOTES = Path(__file__).with_name('topics.yaml')
# Where the parameters of each executable stand.
PARAMETERS = {
    'world_sim': 'world.settings',
    'uav_agent': 'agent.settings',
    'recorder': 'recorder.node',
    'trainer': 'trainer.settings',
    'viewer': 'viewer.node',
}
# The files that explain every key of their kind.
KEYS = {
    'A scenario': 'config/scenarios/paper_10x10.yaml',
    'Craft': 'config/airframes.yaml',
    'What `field` proposes': 'config/fields/usual.yaml',
    'A training': 'config/training/paper.yaml',
    'Courses of a training for any field': 'config/training/courses/anywhere.yaml',
    'Going on with a policy on one field': 'config/training/field.yaml',
    'A scale of the studies': 'config/studies/laptop.yaml',
    'Parameters of the nodes': 'config/nodes.yaml',
}
_COLUMNS = '80'  # of a terminal
_BOX = (150, 34, 12)  # width, height and gap of a room in the picture, px
_BOX_DRAWN = (
    f'<rect x="{{x:g}}" y="{{y:g}}" width="{_BOX[0]}" height="{_BOX[1]}" rx="6"'
    ' fill="#00968833" stroke="#009688"/>'
    '<text x="{at:g}" y="{on:g}" text-anchor="middle" fill="currentColor">{room}</text>'
)


class Entry(NamedTuple):
    """A field or constant of a message."""

    type_name: str
    name: str
    meaning: str


def table(titles: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    """A table of Markdown."""
    titles = [*titles]
    lines = [titles, ['---'] * len(titles), *([*map(_in_a_cell, row)] for row in rows)]
    return '\n'.join(f'| {" | ".join(line)} |' for line in lines)


def _in_a_cell(text: str) -> str:
    return text.replace('|', '\\|')


def targets() -> str:
    """What make does, by what it is asked for."""
    found = re.findall(r'^([\w-]+):.*?##  ?(.*)$', (ROOT / 'Makefile').read_text(), re.MULTILINE)
    rows = [(f'`make {name}`', escape(what, quote=False)) for name, what in found]
    return table(('make', 'what'), rows)


def summaries() -> str:
    """Each command with what it is for."""
    return table(('command', 'what'), [(f'`{name}`', what) for name, what in SUMMARIES.items()])


def commands() -> str:
    """What each command says of itself when asked for help."""
    parts = []
    before = os.environ.get('COLUMNS')
    os.environ['COLUMNS'] = _COLUMNS
    try:
        for name, summary in SUMMARIES.items():
            parser = argparse.ArgumentParser(prog=f'python -m uav_collect {name}')
            command_named(name).add_arguments(parser)
            parts.append(f'## {name}\n\nTo {summary}.\n\n```text\n{parser.format_help()}```\n')
    finally:
        if before is None:
            del os.environ['COLUMNS']
        else:
            os.environ['COLUMNS'] = before
    return '\n'.join(parts)


def parameters() -> str:
    """The ROS parameters of every node, with defaults and bounds."""
    return '\n\n'.join(
        f'## {executable}\n\n{table(("parameter", "default", "from, to", "meaning"), rows)}'
        for executable, module in PARAMETERS.items()
        for rows in [map(_parameter_row, import_module(f'uav_collect.nodes.{module}').PARAMETERS)]
    )


def _parameter_row(parameter: Any) -> tuple[str, ...]:  # noqa: ANN401 - ROS's types carry none
    bounds = '' if parameter.low is None else f'{parameter.low:,} to {parameter.high:,}'
    change = '; may change in flight' if parameter.in_flight else ''
    default = repr(parameter.default)
    return f'`{parameter.name}`', f'`{default}`', bounds, parameter.description + change


def topics() -> str:
    """Every topic with its type and delivery, who sends, who reads, and what for."""
    module = import_module('uav_collect.nodes.topics')
    known = {topic.name: topic for topic in (*module.fleet_topics(1), module.RECORDER)}
    rows = []
    for name, note in yaml.safe_load(TOPIC_NOTES.read_text()).items():
        topic = known[name.replace('uav_N', 'uav_1')]
        delivery = _delivery(topic.qos)
        cells = (note['from'], note['to'], delivery, note['meaning'])
        rows.append((f'`{name}`', f'`{topic.type_name}`', *cells))
    return table(('topic', 'type', 'from', 'to', 'delivery', 'meaning'), rows)


def _delivery(qos: Any) -> str:  # noqa: ANN401
    """A quality of service in words."""
    reliability = qos.reliability.name.lower().replace('_', ' ')
    latched = 'latched ' if qos.durability.name == 'TRANSIENT_LOCAL' else ''
    is_noticed = 0 < qos.liveliness_lease_duration.nanoseconds < 1e12  # unset, it is without end
    noticed = ', with liveliness' if is_noticed else ''
    return f'{reliability.replace("system default", "reliable")}, {latched}{qos.depth}{noticed}'


def services() -> str:
    """Every service and action, with what its file opens with."""
    names = {'Join': 'join', 'ControlMission': 'control', 'InjectFault': 'inject'}
    names |= {'FlyMission': 'fly_mission', 'Vouch': 'vouch_X'}
    rows = [
        (
            f'`/world/{names[path.stem]}`',
            f'[`{path.stem}`](messages.md#{path.stem.lower()})',
            opening,
        )
        for path in _interfaces('srv', 'action')
        for opening in [_sections(path)[0][0]]
    ]
    return table(('service or action', 'type', 'meaning'), rows)


def messages() -> str:
    """Every message, service and action: what it is, its fields with their units."""
    return '\n\n'.join(_interface(path) for path in _interfaces('msg', 'srv', 'action'))


def _interfaces(*kinds: str) -> list[Path]:
    return [path for kind in kinds for path in sorted((INTERFACES / kind).glob(f'*.{kind}'))]


def _interface(path: Path) -> str:
    (opening, _), *_ = sections = _sections(path)
    titles = {'srv': ('Request', 'Answer'), 'action': ('Goal', 'Result', 'Feedback')}
    parts = [f'## {path.stem}', opening]
    for title, (_, entries) in zip(titles.get(path.suffix[1:], ('',)), sections, strict=True):
        rows = [(f'`{it.type_name}`', f'`{it.name}`', it.meaning) for it in entries]
        parts += [f'### {title} of {path.stem}'] if title else []
        parts += [table(('type', 'name', 'meaning'), rows)]
    return '\n\n'.join(parts)


def _sections(path: Path) -> list[tuple[str, list[Entry]]]:
    """The parts of an interface: the comment that stands apart at its head, and its entries."""
    return [_section(text) for text in re.split(r'^---\n', path.read_text(), flags=re.MULTILINE)]


def _section(text: str) -> tuple[str, list[Entry]]:
    opening, comment, entries = '', [], []
    for line in text.splitlines():
        if line.startswith('#'):
            comment.append(escape(line.lstrip('# '), quote=False))
        elif not line.strip():
            opening, comment = opening or ' '.join(comment), []
        else:
            type_name, _, name = line.partition(' ')
            entries.append(Entry(type_name, name.strip(), ' '.join(comment)))
            comment = []
    return opening, entries


def keys() -> str:
    """The files that explain every key."""
    return '\n'.join(
        f'## {title}\n\n`{name}`\n\n```yaml\n{(ROOT / name).read_text()}```\n'
        for title, name in KEYS.items()
    )


def python() -> str:
    """The names that `import uav_collect` gives, for mkdocstrings to fill in."""
    homes = {name: module for module, names in uav_collect._NAMES_OF.items() for name in names}
    return '\n\n'.join(
        f'::: uav_collect.{homes[name]}.{name}' for name in uav_collect.__all__ if name in homes
    )


def architecture() -> str:
    """A picture of the rooms, each floor above those that it stands on."""
    graph = structure.room_graph(structure.module_graph(structure.read()))
    floors = _floors(graph)
    width, height, gap = _BOX
    most = max(map(len, floors))
    size = f'0 0 {most * (width + gap)} {len(floors) * (height + gap)}'
    style = 'width: 100%; font-size: 13px'
    drawn = '\n'.join(_boxes(floors))
    return f'<div><svg viewBox="{size}" role="img" style="{style}">\n{drawn}\n</svg></div>'


def _floors(graph: dict[str, set[str]]) -> list[list[str]]:
    """Rooms by floor, the lowest first: each stands on the highest of those that it imports."""
    floor_of: dict[str, int] = {}
    for room in structure.ORDER:
        below = [floor_of[it] for it in graph.get(room, ()) if it in floor_of and it != room]
        floor_of[room] = 1 + max(below, default=-1)
    n_floors = 1 + max(floor_of.values())
    return [[room for room, at in floor_of.items() if at == floor] for floor in range(n_floors)]


def _boxes(floors: list[list[str]]) -> Iterator[str]:
    width, height, gap = _BOX
    most = max(map(len, floors))
    for level, rooms in enumerate(reversed(floors)):
        left = (most - len(rooms)) * (width + gap) / 2
        for column, room in enumerate(rooms):
            x, y = left + column * (width + gap), level * (height + gap)
            yield _BOX_DRAWN.format(x=x, y=y, at=x + width / 2, on=y + height / 2 + 5, room=room)


GENERATED: dict[str, Callable[[], str]] = {
    **{'architecture': architecture, 'commands': commands, 'keys': keys, 'messages': messages},
    **{'parameters': parameters, 'python': python, 'services': services, 'summaries': summaries},
    **{'targets': targets, 'topics': topics},
}
_PART = re.compile(r'<!-- generated: (\w+) -->(\n\n.*?\n\n<!-- end -->)?', re.DOTALL)


def filled(text: str) -> str:
    """A page with all of its generated parts in place."""
    return _PART.sub(lambda found: GENERATED[found[1]](), text)


def renewed(text: str) -> str:
    """The source of a page, with those parts made anew that stand in it."""
    return _PART.sub(_part_of_a_source, text)


def _part_of_a_source(found: re.Match[str]) -> str:
    if not found[2]:
        return found[0]
    return f'<!-- generated: {found[1]} -->\n\n{GENERATED[found[1]]()}\n\n<!-- end -->'


if __name__ == '__main__':
    for page in sorted((ROOT / 'docs' / 'reference').glob('*.md')):
        page.write_text(renewed(page.read_text()))
