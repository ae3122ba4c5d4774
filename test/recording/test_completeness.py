"""What a recording lacks, by what the events of its missions say."""

from collections.abc import Iterable, Sequence
import gc
import random

from bags import ABORTED, definition_text, HandMadeMessages
import pytest
from scripted_logs import fly, header, uav
from tiny_world import tiny
from tiny_world import uav as tiny_uav
from uav_collect.errors import UnreadableError
from uav_collect.missions import rollout
from uav_collect.recording import completeness as completeness_module
from uav_collect.recording.bag_writer import MessageTypes
from uav_collect.recording.completeness import Completeness, Lack
from uav_collect.recording.mission_log import MissionLog
from uav_collect.scenario.site import build_site

MESSAGES = HandMadeMessages()
TYPES = MessageTypes(definition_text)

Recorded = Sequence[tuple[str, bytes]]


@pytest.fixture(scope='module')
def log() -> MissionLog:
    """Two UAVs in contact all the time."""
    (flown,) = rollout.fly(build_site(tiny(tiny_uav(), tiny_uav(speed_mps=10.0))), [3], 'sweep')
    assert flown.events['heard'].any()
    return flown


@pytest.fixture(scope='module')
def mission(log: MissionLog) -> Recorded:
    return [*MESSAGES.of_mission(log, 'w-0')]


def held(messages: Iterable[tuple[str, bytes]], namespace: str = '') -> Completeness:
    completeness = Completeness(TYPES.fields, namespace)
    given = [*messages]
    takers = {topic: completeness.taker(topic) for topic, _ in given}
    for topic, content in given:
        take = takers[topic]
        assert take is not None
        take(content)
    return completeness


def n_kept() -> int:
    """How many missions are in mind."""
    gc.collect()
    return sum(type(each) is completeness_module._Mission for each in gc.get_objects())


def lacks(messages: Iterable[tuple[str, bytes]]) -> dict[str, int]:
    return {lack.topic: lack.n_messages for lack in held(messages).lacks()}


def test_a_mission_that_is_here_lacks_nothing_in_whatever_order_it_came(mission: Recorded) -> None:
    assert lacks(mission) == {}
    shuffled = [*mission]
    random.Random(1).shuffle(shuffled)
    assert lacks(shuffled) == {}


@pytest.mark.parametrize(
    'topic',
    ['/uav_1/observation', '/uav_2/command', '/uav_1/radio_tx', '/uav_2/radio_rx', '/world/epoch'],
)
def test_every_message_that_is_not_here_is_counted_for_its_topic(
    topic: str, mission: Recorded
) -> None:
    places = [place for place, (name, _) in enumerate(mission) if name == topic]
    for gone in ([places[0]], [places[-1]], places[1:3]):
        left = [message for place, message in enumerate(mission) if place not in gone]
        expected = lacks(left)
        assert expected == {topic: len(gone)} or topic == '/world/epoch'
        assert expected[topic] == len(gone)


def test_a_topic_that_is_missing_as_a_whole_is_counted(mission: Recorded) -> None:
    topics = {topic for topic, _ in mission if topic.startswith('/uav_')}
    n_of = {topic: sum(name == topic for name, _ in mission) for topic in topics}
    assert lacks(message for message in mission if not message[0].startswith('/uav_')) == n_of
    n_epochs = sum(name == '/world/epoch' for name, _ in mission)
    assert lacks(it for it in mission if it[0] == '/world/mission') == {'/world/epoch': n_epochs}


def test_a_mission_in_flight_is_judged_up_to_its_last_event(mission: Recorded) -> None:
    epochs = [place for place, (name, _) in enumerate(mission) if name == '/world/epoch']
    so_far = mission[: epochs[4] + 1]
    assert lacks(so_far) == {}
    assert lacks(mission[: epochs[5]]) == {}  # the next decision is under way
    assert lacks(it for it in so_far if it != mission[epochs[2]]) == {'/world/epoch': 1}


def test_an_aborted_mission_is_judged_up_to_its_last_event(log: MissionLog) -> None:
    aborted = [*MESSAGES.of_mission(log, 'w-0', end=ABORTED)]
    epochs = [place for place, (name, _) in enumerate(aborted) if name == '/world/epoch']
    assert lacks([*aborted[: epochs[4] + 1], aborted[-1]]) == {}


def test_what_comes_after_the_recorder_was_asked_to_stop_is_not_expected(
    log: MissionLog, mission: Recorded
) -> None:
    epochs = [place for place, (name, _) in enumerate(mission) if name == '/world/epoch']
    completeness = held(mission[: epochs[4] + 1])
    completeness.freeze()
    take = completeness.taker('/world/epoch')
    assert take is not None
    take(mission[epochs[5]][1])  # whose other messages are on their way
    assert completeness.lacks() == []
    for topic, content in (*mission[epochs[7] :], *MESSAGES.of_mission(log, 'w-1', end=ABORTED)):
        late = completeness.taker(topic)
        assert late is not None
        if topic.startswith('/world/'):  # which may overtake all others
            late(content)
    assert completeness.lacks() == []


def test_a_failsafe_is_no_decision_of_an_agent() -> None:
    log = fly(header([uav(1)]), [['hover 2.0 0.5', 'home failsafe']])
    messages = [*MESSAGES.of_mission(log, 'w-0')]
    answers = {'/uav_1/command', '/uav_1/radio_tx', '/uav_1/observation'}
    gone = {topic: max(i for i, it in enumerate(messages) if it[0] == topic) for topic in answers}
    left = [message for place, message in enumerate(messages) if place not in gone.values()]
    assert lacks(left) == {}


def test_transitions_are_expected_where_an_agent_publishes_them(
    log: MissionLog, mission: Recorded
) -> None:
    n_decisions = int((log.events['uav'] == 1).sum())
    transitions = [
        ('/uav_1/transition', MESSAGES.serialized('Transition', mission_id='w-0', decision=number))
        for number in range(n_decisions)
    ]
    assert lacks([*mission, *transitions]) == {}
    assert lacks([*mission, *transitions[:-2]]) == {'/uav_1/transition': 2}


def test_what_is_missing_is_named_with_its_missions(log: MissionLog) -> None:
    missions = [[*MESSAGES.of_mission(log, f'w-{number}')] for number in range(3)]
    left = [it for mission in missions for it in mission if it[0] != '/uav_1/command']
    n_commands = sum(name == '/uav_1/command' for name, _ in missions[0])
    (lack,) = held(left).lacks()
    assert lack == Lack('/uav_1/command', 3 * n_commands, 3, 'w-0')
    assert str(lack) == f'/uav_1/command lacks {3 * n_commands} of mission w-0 and 2 more'


def test_what_agents_say_of_missions_that_no_world_tells_of_is_no_gap(mission: Recorded) -> None:
    assert lacks(it for it in mission if not it[0].startswith('/world/')) == {}


def test_topics_of_other_worlds_and_viewers_are_none_of_its_business() -> None:
    completeness = Completeness(TYPES.fields, '/a')
    for topic in ('/world/epoch', '/b/world/epoch', '/a/world/markers', '/a/uav_1/refusal'):
        assert completeness.taker(topic) is None
    assert completeness.taker('/a/uav_1/command') is not None


def test_thousands_of_missions_take_no_more_room_than_a_few(log: MissionLog) -> None:
    completeness = Completeness(TYPES.fields)
    takers = {topic: completeness.taker(topic) for topic, _ in MESSAGES.of_mission(log, 'w-0')}
    for number in range(200):
        for topic, content in MESSAGES.of_mission(log, f'w-{number}'):
            takers[topic](content)  # type: ignore[misc]
    assert n_kept() <= 64
    assert completeness.lacks() == []


def test_whatever_comes_a_flood_of_missions_has_its_bound(log: MissionLog) -> None:
    completeness = Completeness(TYPES.fields)
    take = completeness.taker('/world/epoch')
    assert take is not None
    n_missions = 1_500
    for number in range(n_missions):
        take(MESSAGES.serialized('Epoch', mission_id=f'w-{number}', event=1, uav=1))
    assert n_kept() <= 1_064
    total = {lack.topic: lack for lack in completeness.lacks()}
    assert total['/world/epoch'].n_messages == n_missions
    assert total['/world/mission'].n_missions == n_missions


@pytest.mark.parametrize('topic', ['/world/mission', '/world/epoch', '/uav_1/radio_rx'])
def test_bytes_that_are_no_message_change_nothing(topic: str, mission: Recorded) -> None:
    completeness, draw = held(mission), random.Random(2)
    take = completeness.taker(topic)
    assert take is not None
    for _ in range(2_000):
        with pytest.raises(UnreadableError):
            take(b'\0\1\0\0' + draw.randbytes(draw.randrange(12)))
    assert completeness.lacks() == []
