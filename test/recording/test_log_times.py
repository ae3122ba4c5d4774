"""The log times of a recording, by messages made by hand."""

from pathlib import Path
import struct

from bags import HandMadeBag, HandMadeMessages
import pytest
from rosbags.highlevel import AnyReader
from rosbags.typesys import get_typestore, Stores
from uav_collect.recording.log_times import LogTimes, StampReader

TYPES = get_typestore(Stores.ROS2_JAZZY)
EPOCH, CLOCK = 'uav_collect_msgs/msg/Epoch', 'rosgraph_msgs/msg/Clock'
RADIO, OBSERVATION = 'uav_collect_msgs/msg/RadioMessage', 'uav_collect_msgs/msg/Observation'
ODOMETRY = 'nav_msgs/msg/Odometry'


def fields_of(type_name: str):  # noqa: ANN201 - as rosbags has them
    return TYPES.fielddefs[type_name][1]


def time(second: int, nanosecond: int = 0) -> object:
    return TYPES.types['builtin_interfaces/msg/Time'](second, nanosecond)


def header(second: int, nanosecond: int = 0) -> object:
    return TYPES.types['std_msgs/msg/Header'](time(second, nanosecond), 'map')


def transforms(*seconds: int) -> bytes:
    def of(name: str) -> type:
        return TYPES.types[f'geometry_msgs/msg/{name}']

    parts = [
        of('TransformStamped')(
            header(second),
            'uav_1/base_link',
            of('Transform')(of('Vector3')(0.0, 0.0, 0.0), of('Quaternion')(0.0, 0.0, 0.0, 1.0)),
        )
        for second in seconds
    ]
    message = TYPES.types['tf2_msgs/msg/TFMessage'](parts)
    return bytes(TYPES.serialize_cdr(message, 'tf2_msgs/msg/TFMessage'))


def clock(second: int, nanosecond: int = 0) -> bytes:
    return bytes(TYPES.serialize_cdr(TYPES.types[CLOCK](time(second, nanosecond)), CLOCK))


def stamp_ns(type_name: str, content: bytes) -> int | None:
    return StampReader(type_name, fields_of).read_ns(content)


def test_the_stamp_is_the_first_field_of_a_clock() -> None:
    assert stamp_ns(CLOCK, clock(7, 25)) == 7_000_000_025


def test_a_stamp_in_a_header_is_read() -> None:
    name = 'nav_msgs/msg/Path'
    content = bytes(TYPES.serialize_cdr(TYPES.types[name](header(3, 4), []), name))
    assert stamp_ns(name, content) == 3_000_000_004


def test_a_list_of_messages_has_the_stamp_of_its_first() -> None:
    assert stamp_ns('tf2_msgs/msg/TFMessage', transforms(5, 6)) == 5_000_000_000
    assert stamp_ns('tf2_msgs/msg/TFMessage', transforms()) is None


@pytest.mark.parametrize(
    'content', [b'', b'\0\1\0\0', clock(1)[:-1], b'\0\0' + clock(1)[2:], clock(-1)]
)
def test_what_is_no_stamp_of_a_clock_is_none(content: bytes) -> None:
    assert stamp_ns(CLOCK, content) is None


@pytest.mark.parametrize('name', ['std_msgs/msg/String', 'std_msgs/msg/Empty'])
def test_a_type_without_a_stamp_has_none(name: str) -> None:
    assert stamp_ns(name, b'\0\1\0\0' + bytes(20)) is None


def test_a_stamp_of_wall_clock_time_is_none() -> None:
    name = 'diagnostic_msgs/msg/DiagnosticArray'
    content = b'\0\1\0\0' + struct.pack('<iI', 1_700_000_000, 0) + bytes(20)
    assert stamp_ns(name, content) is None


@pytest.fixture
def times() -> LogTimes:
    """Those of a recording that knows the world `a`."""
    times = LogTimes()
    times.begin_world('a')
    return times


def now_ns(times: LogTimes) -> int:
    """What the clock of a recording shows."""
    return times.log_ns('/note', 'std_msgs/msg/String', None)


def test_a_message_is_logged_at_its_stamp_and_one_without_at_the_clock(times: LogTimes) -> None:
    assert now_ns(times) == 0
    assert times.log_ns('/world/epoch', EPOCH, 5, 'a-0') == 5
    assert times.log_ns('/uav_1/odometry', ODOMETRY, 9) == 9
    assert now_ns(times) == 5
    assert times.log_ns('/world/epoch', EPOCH, 3, 'a-0') == 3  # it came late
    assert now_ns(times) == 5
    assert times.log_ns('/uav_1/observation', OBSERVATION, 7, 'a-0') == 7
    assert now_ns(times) == 7


def test_what_a_uav_hears_is_logged_at_the_clock_however_long_ago_it_was_sent(
    times: LogTimes,
) -> None:
    assert times.log_ns('/world/epoch', EPOCH, 20, 'a-0') == 20
    assert times.log_ns('/uav_2/radio_tx', RADIO, 5, 'a-0') == 5
    assert times.log_ns('/w/uav_1/radio_rx', RADIO, 5, 'a-0') == 20
    assert times.log_ns('/uav_1/radio_rx', RADIO, 30, 'a-0') == 30  # topics are not ordered
    assert times.log_ns('/uav_1/radio_rx', RADIO, 25, 'a-0') == 30


def test_what_a_second_world_tells_follows_what_the_first_one_did() -> None:
    times = LogTimes()
    assert times.log_ns('/world/epoch', EPOCH, 60, 'a-0') == 60  # before the first one was known
    times.begin_world('a')
    assert times.log_ns('/world/epoch', EPOCH, 70, 'a-0') == 70
    times.begin_world('b')
    assert times.log_ns('/clock', CLOCK, 1) == 71
    assert times.log_ns('/world/epoch', EPOCH, 2, 'b-0') == 72
    assert now_ns(times) == 72


def test_each_world_keeps_its_place_in_time_however_often_it_presents_itself(
    times: LogTimes,
) -> None:
    assert times.log_ns('/world/epoch', EPOCH, 70, 'a-0') == 70
    for number in range(100):
        times.begin_world(f'b{number}')
    assert times.log_ns('/world/epoch', EPOCH, 1, 'b0-0') == 71
    assert times.log_ns('/world/epoch', EPOCH, 80, 'a-0') == 80  # of both some may come late
    assert times.log_ns('/uav_1/odometry', ODOMETRY, 81) == 81  # of the world that flies
    times.begin_world('a')
    assert times.log_ns('/world/epoch', EPOCH, 82, 'a-1') == 82


@pytest.mark.parametrize(
    ('topic', 'type_name', 'mission_id'),
    [
        ('/clock', CLOCK, ''),
        ('/world/epoch', EPOCH, 'foreign-0'),
        ('/uav_1/radio_rx', RADIO, 'foreign-0'),
        ('/uav_1/radio_tx', RADIO, 'a-0'),  # of an agent
        ('/uav_1/odometry', ODOMETRY, ''),
    ],
)
@pytest.mark.parametrize('has_world', [True, False])
def test_no_one_but_a_known_world_moves_the_clock(
    has_world: bool, topic: str, type_name: str, mission_id: str
) -> None:
    times = LogTimes()
    if has_world:
        times.begin_world('a')
        times.log_ns('/world/epoch', EPOCH, 5, 'a-0')
    before_ns = now_ns(times)
    logged_ns = times.log_ns(topic, type_name, 10**18, mission_id)
    assert now_ns(times) == before_ns
    if has_world and mission_id.startswith('foreign'):
        assert logged_ns == before_ns
    times.begin_world('b')
    assert times.log_ns('/world/epoch', EPOCH, 1, 'b-0') == before_ns + 1


def test_of_the_clock_one_message_is_kept_after_each_event() -> None:
    times = LogTimes()
    assert [times.keeps_clock() for _ in range(3)] == [True, False, False]
    times.note_event()
    times.note_event()
    assert [times.keeps_clock() for _ in range(2)] == [True, False]


def test_messages_are_read_by_time_and_those_of_one_time_as_they_came(tmp_path: Path) -> None:
    bag = HandMadeBag(tmp_path / 'bag')
    bag.add('/world/epoch', 'Epoch', event=0)  # announces the topic; its time is 1
    topic, made = bag.topics['/world/epoch'], HandMadeMessages()
    for event, log_ns in ((1, 30), (2, 20), (3, 20), (4, 30), (5, 10)):
        bag.writer.write(topic, log_ns, made.serialized('Epoch', event=event))
    bag.writer.flush()
    for event, log_ns in ((6, 20), (7, 40)):  # of a later chunk, and an earlier time
        bag.writer.write(topic, log_ns, made.serialized('Epoch', event=event))
    bag.writer.close()
    with AnyReader([tmp_path / 'bag']) as reader:
        read = [
            (int(reader.deserialize(content, it.msgtype).event), log_ns)
            for it, log_ns, content in reader.messages()
        ]
    assert read == [(0, 1), (5, 10), (2, 20), (3, 20), (6, 20), (1, 30), (4, 30), (7, 40)]
