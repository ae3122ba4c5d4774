"""The views that are shipped for RViz, Foxglove and PlotJuggler show topics that there are."""

from collections.abc import Iterator
from importlib import import_module
import json
from pathlib import Path
import re
from typing import Any
from xml.etree import ElementTree

import pytest

topics = pytest.importorskip('uav_collect.nodes.topics', reason='needs the messages of ROS')
import yaml

CONFIG = Path(__file__).parents[2] / 'config'
TOPICS = {topic.name: topic for topic in topics.fleet_topics(2)}
RVIZ_UPDATES = '_updates'  # RViz looks for parts of a grid beside it


def texts(part: Any) -> Iterator[str]:  # noqa: ANN401 - what a file holds
    """All texts in nested lists and mappings, keys too."""
    if isinstance(part, str):
        yield part
    elif isinstance(part, dict):
        for key, value in part.items():
            yield from (key, *texts(value))
    elif isinstance(part, list):
        for value in part:
            yield from texts(value)


def rviz() -> set[str]:
    view = yaml.safe_load((CONFIG / 'rviz' / 'mission.rviz').read_text())
    shown = view['Visualization Manager']['Displays']
    return {it for it in texts(shown) if it.startswith('/') and not it.endswith(RVIZ_UPDATES)}


def foxglove() -> set[str]:
    panels = json.loads((CONFIG / 'foxglove' / 'mission.json').read_text())['configById']
    return {text for text in texts(panels) if text.startswith('/')}


def plotjuggler() -> set[str]:
    root = ElementTree.parse(CONFIG / 'plotjuggler' / 'mission.xml').getroot()
    curves = [*root.iter('curve')]
    names = [curve.get('name') for curve in curves if curve.get('curve_x') is None]
    sides = [curve.get(side) for curve in curves for side in ('curve_x', 'curve_y')]
    return {name for name in (*names, *sides) if name}


def is_there(shown: str) -> bool:
    """Whether something is a topic, or a field in messages on a topic, after dots or slashes."""
    for name, topic in TOPICS.items():
        if shown == name:
            return True
        if shown.startswith((f'{name}/', f'{name}.')):
            return has_field(topic.message, re.split(r'[./]', shown[len(name) + 1 :]))
    return False


def has_field(message: Any, path: list[str]) -> bool:  # noqa: ANN401 - a class of messages
    kind = message.get_fields_and_field_types().get(path[0])
    if kind is None or len(path) == 1:
        return kind is not None
    package, _, name = kind.partition('/')
    return has_field(getattr(import_module(f'{package}.msg'), name), path[1:])


@pytest.mark.parametrize('read', [rviz, foxglove, plotjuggler])
def test_a_view_shows_topics_that_there_are(read: Any) -> None:  # noqa: ANN401
    shown = read()
    assert len(shown) > 4
    assert {name for name in shown if not is_there(name)} == set()


@pytest.mark.parametrize('name', ['/uav_3/path', '/uav_1/battery/charm', '/world/epoch.stamp.x'])
def test_a_topic_or_field_that_there_is_none_of_is_seen(name: str) -> None:
    assert not is_there(name)


def test_the_panels_of_foxglove_are_those_of_its_layout() -> None:
    view = json.loads((CONFIG / 'foxglove' / 'mission.json').read_text())
    placed = [text for text in texts(view['layout']) if '!' in text]
    assert sorted(placed) == sorted(view['configById'])
