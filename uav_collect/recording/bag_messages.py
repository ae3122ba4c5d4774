"""The messages of bags, by the types that bags define, if these are those of the fleet."""

from collections.abc import Callable, Iterator, Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any

from rosbags.serde import SerdeError
from rosbags.typesys import (
    get_types_from_idl,
    get_types_from_msg,
    get_typestore,
    Stores,
    TypesysError,
)
from rosbags.typesys.store import Typestore
from uav_collect.errors import BagError, in_one_line
from uav_collect.recording.bag_storage import Bag, open_bag, RecordedTopic
from uav_collect.recording.log_model import EVENT_DTYPE

_PACKAGE = 'uav_collect_msgs/msg/'
# The type of the messages on a topic, by the last part of its name.
_TYPES = {
    'scenario': 'Scenario',
    'mission': 'Mission',
    'epoch': 'Epoch',
    'observation': 'Observation',
    'command': 'Command',
    'transition': 'Transition',
    'radio_tx': 'RadioMessage',
    'radio_rx': 'RadioMessage',
    'policy': 'Policy',
}
_TEXT, _WHOLE, _NUMBER, _FLAG, _LIST = 'a text', 'a whole number', 'a number', 'a flag', 'a list'
_BY_LETTER = {'f': _NUMBER, 'i': _WHOLE, 'u': _LIST}  # the unsigned one is who was heard
# Fields without which no mission can be told; and what they must be.
_FIELDS: Mapping[str, Mapping[str, str]] = {
    'Scenario': {
        **dict.fromkeys(('world_instance', 'yaml', 'fingerprint'), _TEXT),
        **dict.fromkeys(('sensor_x_m', 'sensor_y_m'), _LIST),
    },
    'Mission': {
        **dict.fromkeys(('mission_id', 'world_instance', 'scenario_fingerprint'), _TEXT),
        **dict.fromkeys(('phase', 'index', 'seed'), _WHOLE),
        'log_header': _TEXT,
        'demand_bit': _LIST,
    },
    'Epoch': {
        'mission_id': _TEXT,
        **{name: _BY_LETTER[EVENT_DTYPE[name].kind] for name in EVENT_DTYPE.names or ()},
        'terminal': _FLAG,
    },
    'RadioMessage': {'mission_id': _TEXT},
    **{name: {'mission_id': _TEXT} for name in ('Observation', 'Command', 'Transition')},
}
_MOST_CHARACTERS = 80  # of a name that is shown
_SEPARATOR = f'{"=" * 80}\n'
# What rosbags raises where a definition makes no sense.
DEFINITION_ERRORS = (
    *(TypesysError, AssertionError, AttributeError, IndexError, KeyError),
    *(RecursionError, SyntaxError, TypeError, ValueError),
)


class MessageReader:
    """Reads the messages of some topics of a bag; what cannot be read is named."""

    def __init__(self, bag: Bag, is_wanted: Callable[[str], bool]) -> None:
        """Learn the types of the topics.

        Args:
            is_wanted: of a topic, by its name.
        """
        self.problems: list[str] = []  # topics that cannot be read; one line each
        self._bag = bag
        self._stores: dict[RecordedTopic, Typestore] = {}
        for topic in dict.fromkeys(bag.topics):
            if is_wanted(topic.name):
                try:
                    self._stores[topic] = _store_of(topic)
                except DEFINITION_ERRORS as error:
                    why = in_one_line(str(error)) or type(error).__name__
                    self.problems.append(f'topic {_short(topic.name)}: {why}')

    def messages(
        self, is_accepted: Callable[[str, bytes], bool] | None = None
    ) -> Iterator[tuple[str, Any]]:
        """Topic and content of the messages, by time, but bytes that are none.

        Args:
            is_accepted: of a serialized message on a topic; None: all are.
        """
        for topic, _, content in self._bag.messages(self._stores.__contains__):
            if is_accepted is not None and not is_accepted(topic.name, content):
                continue
            try:
                message = self._stores[topic].deserialize_cdr(content, topic.type_name)
            except SerdeError:
                continue
            yield topic.name, message


def messages(
    path: Path,
    is_wanted: Callable[[str], bool],
    is_accepted: Callable[[str, bytes], bool] | None = None,
    damages: list[str] | None = None,
) -> Iterator[tuple[str, Any]]:
    """Topic and content of the messages of some topics, by time, but bytes that are none.

    Args:
        path: folder or file of the bag.
        is_wanted: of a topic, by its name.
        is_accepted: of a serialized message on a topic; None: all are.
        damages: takes what is damaged, and the rest is read; None: nothing may be.

    Raises:
        BagError: there is no bag, or it is damaged.
    """
    with open_bag(path) as bag:
        reader = MessageReader(bag, is_wanted)
        if damages is None:
            refuse_damages(bag, reader.problems)
        yield from reader.messages(is_accepted)
        if damages is None:
            refuse_damages(bag, reader.problems)
        else:
            damages += [*bag.damages, *reader.problems]


def refuse_damages(bag: Bag, problems: list[str]) -> None:
    """Raise a BagError if anything of a bag is not as it was written."""
    found = [*bag.damages, *problems, *bag.remarks]
    if found:
        more = f' and {len(found) - 1} more' if len(found) > 1 else ''
        raise BagError(f'{bag.path}: {found[0]}{more}{repair_hint(bag)}')


def repair_hint(bag: Bag) -> str:
    """What to add to a line about a bag; empty where there is nothing to repair."""
    return f'; recorder --repair {bag.path} keeps what is whole' if bag.damages else ''


@lru_cache(maxsize=64)
def _store_of(topic: RecordedTopic) -> Typestore:
    """The types of a topic.

    Raises:
        ValueError: a topic of the fleet has messages of another type, or of another
            serialization.
    """
    wanted = _TYPES.get(topic.name.rpartition('/')[2])
    if wanted is not None and topic.type_name != _PACKAGE + wanted:
        raise ValueError(f'its type is {_short(topic.type_name)}: must be {_PACKAGE}{wanted}')
    if topic.serialization != 'cdr':
        raise ValueError(f'its messages are {_short(topic.serialization)}: must be cdr')
    if not topic.definition:
        type_name = _short(topic.type_name)
        raise ValueError(f'the bag does not define {type_name}: a ROS before Iron has recorded it')
    store = types_of(topic)
    _, fields = store.fielddefs[topic.type_name]
    kinds = {name: _kind(field) for name, field in fields}
    for name, kind in _FIELDS.get(topic.type_name.removeprefix(_PACKAGE), {}).items():
        if kinds.get(name) != kind:
            found = kinds.get(name, 'missing')
            raise ValueError(f'{name} of its type is {found}: must be {kind}, as in this version')
    return store


@lru_cache(maxsize=256)
def types_of(topic: RecordedTopic) -> Typestore:
    """The types that a topic's definition defines; raises one of DEFINITION_ERRORS."""
    store = get_typestore(Stores.EMPTY)
    store.register(_definitions_of(topic))
    store.get_msgdef(topic.type_name)  # asks for all types that it is made of
    return store


def _definitions_of(topic: RecordedTopic) -> Any:  # noqa: ANN401 - of rosbags
    if topic.encoding == 'ros2msg':
        return get_types_from_msg(topic.definition, topic.type_name)
    if not topic.definition.startswith(f'{_SEPARATOR}IDL: '):
        return get_types_from_idl(topic.definition)
    types: dict[str, Any] = {}
    for part in topic.definition.split(_SEPARATOR)[1:]:
        types.update(get_types_from_idl(part.partition('\n')[2]))
    return types


def _kind(field: Any) -> str:  # noqa: ANN401 - nested tuples of rosbags
    """What the values of a field are."""
    kind, what = field
    if kind.name in ('ARRAY', 'SEQUENCE'):
        return _LIST if what[0][0].name == 'BASE' and what[0][1][0] != 'string' else 'another list'
    if kind.name != 'BASE':
        return 'a message'
    if what[0].startswith('float'):
        return _NUMBER
    return {'string': _TEXT, 'bool': _FLAG}.get(what[0], _WHOLE)


def _short(name: str) -> str:
    return in_one_line(name, _MOST_CHARACTERS) or "''"
