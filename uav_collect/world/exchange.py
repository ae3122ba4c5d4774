"""How UAVs hear each other where messages are lost, come late, or do not fit.

A UAV sends its completion map and its place when it decides, to all in contact; they answer with
theirs; and at every beacon period, decide or not. Of each message to each receiver it is drawn
whether it is lost and how long it takes; a radio that still sends takes no other message. What
has arrived by a decision is heard there: the newest message of each sender, which holds all that
was in those before, for maps only grow.

Messages under way keep no map. They are numbered over the fleet, and each radio keeps for every
cell how many had been sent when it learned that the cell is complete: that is what a message of
a later number tells.
"""

from collections.abc import Sequence
from typing import Any, Generic, NamedTuple, TypeVar

from uav_collect.kernels.arrays import new_table, Row
from uav_collect.kernels.compile import kernel, row_kernel
from uav_collect.kernels.keyed_random import draw_words, UAV_RADIO, uniform_of
from uav_collect.scenario.model import Scenario
from uav_collect.uav.action_codes import NONE
from uav_collect.uav.belief import Belief, belief_of, Beliefs
from uav_collect.uav.briefing import Briefing
from uav_collect.uav.messages import airtime_s
from uav_collect.world.dynamics import contacts, has_landed, Mission, place_at, SILENT

MOST_UNDER_WAY = 64  # messages from one UAV to another; what is sent meanwhile is lost
_NOT_LEARNED = 2**62

_Ints = TypeVar('_Ints')
_Floats = TypeVar('_Floats')


class Link(NamedTuple):
    """What the radio between UAVs is like."""

    is_ideal: int  # heard at once, none lost: nothing below counts
    loss_share: float
    delay_s: float  # mean
    jitter_s: float  # the delay is uniform within the mean plus or minus this
    airtime_s: float  # how long a message takes to send
    beacon_period_s: float  # 0: there are no beacons


class AirwavesRows(NamedTuple, Generic[_Ints, _Floats]):
    """All UAVs' radios of a mission, rows; or of many, tables of rows, (W, ...).

    A pair is a receiver and a sender, place receiver * U + sender. Each has room for K messages.
    """

    n_sent: _Ints  # (1,) by all
    n_beacons: _Ints  # (1,) periods that are over
    busy_until_s: _Floats  # (U,) a radio still sends
    decision: _Ints  # (U,) at which the UAV sent last
    learned: _Ints  # (U * C,) how many had been sent when the UAV learned of a cell
    n_drawn: _Ints  # (U * U,) by pair
    n_under_way: _Ints  # (U * U,) the same
    number: _Ints  # (U * U * K,) of the messages under way, by pair
    sent_s: _Floats  # the same
    arrives_s: _Floats
    x_m: _Floats
    y_m: _Floats
    sent_decision: _Ints
    heard_number: _Ints  # (U * U,) of the newest message that has arrived, by pair; NONE
    heard_s: _Floats  # when it was sent
    heard_x_m: _Floats
    heard_y_m: _Floats
    heard_decision: _Ints
    is_new: _Ints  # 1: the receiver has not decided since


Airwaves = AirwavesRows[Row[int], Row[float]]
FleetAirwaves = AirwavesRows[Row[Row[int]], Row[Row[float]]]


def link_of(scenario: Scenario) -> Link:
    """The radio between the UAVs of a scenario."""
    radio = scenario.radio
    delay_s, jitter_s = radio.delay_s or (0.0, 0.0)
    return Link(
        is_ideal=int(radio.is_ideal),
        loss_share=radio.loss_share or 0.0,
        delay_s=delay_s,
        jitter_s=jitter_s,
        airtime_s=airtime_s(scenario.n_cells, radio.rate_bps),
        beacon_period_s=radio.beacon_period_s or 0.0,
    )


def new_airwaves(link: Link, briefing: Briefing, n_worlds: int) -> FleetAirwaves:
    """Radios before the first message; no room is taken where the radio is ideal."""
    n_uavs = 0 if link.is_ideal else briefing.n_uavs
    n_worlds = 1 if link.is_ideal else n_worlds
    n_cells, n_pairs = briefing.n_rows * briefing.n_columns, n_uavs * n_uavs
    sizes = {
        'n_sent': 1, 'n_beacons': 1, 'busy_until_s': n_uavs, 'decision': n_uavs,
        'learned': n_uavs * n_cells,
    } | dict.fromkeys(
        ('number', 'sent_s', 'arrives_s', 'x_m', 'y_m', 'sent_decision'), n_pairs * MOST_UNDER_WAY
    )  # fmt: skip
    tables: dict[str, Any] = {
        name: new_table(
            n_worlds, sizes.get(name, n_pairs), 0.0 if name.endswith(('_s', '_m')) else 0
        )
        for name in AirwavesRows._fields
    }
    airwaves: FleetAirwaves = AirwavesRows(**tables)
    for world in range(n_worlds):
        clear(airwaves_of(airwaves, world))
    return airwaves


@row_kernel
def airwaves_of(airwaves: FleetAirwaves, world: int) -> Airwaves:
    """The radios of one mission of a batch."""
    return AirwavesRows(
        airwaves.n_sent[world],
        airwaves.n_beacons[world],
        airwaves.busy_until_s[world],
        airwaves.decision[world],
        airwaves.learned[world],
        airwaves.n_drawn[world],
        airwaves.n_under_way[world],
        airwaves.number[world],
        airwaves.sent_s[world],
        airwaves.arrives_s[world],
        airwaves.x_m[world],
        airwaves.y_m[world],
        airwaves.sent_decision[world],
        airwaves.heard_number[world],
        airwaves.heard_s[world],
        airwaves.heard_x_m[world],
        airwaves.heard_y_m[world],
        airwaves.heard_decision[world],
        airwaves.is_new[world],
    )


@kernel
def clear(airwaves: Airwaves) -> None:
    """Back to before the first message."""
    airwaves.n_sent[0] = 0
    airwaves.n_beacons[0] = 0
    for uav in range(len(airwaves.busy_until_s)):
        airwaves.busy_until_s[uav] = 0.0
        airwaves.decision[uav] = 0
    for place in range(len(airwaves.learned)):
        airwaves.learned[place] = _NOT_LEARNED
    for pair in range(len(airwaves.n_drawn)):
        airwaves.n_drawn[pair] = 0
        airwaves.n_under_way[pair] = 0
        airwaves.heard_number[pair] = NONE
        airwaves.is_new[pair] = 0


@kernel
def meet(
    link: Link,
    briefing: Briefing,
    mission: Mission,
    airwaves: Airwaves,
    beliefs: Beliefs,
    first: int,
    uav: int,
    time_s: float,
) -> int:
    """All that happens on the air until a UAV decides; those in contact send it what they know.

    Args:
        beliefs: what the radios keep; the UAV's own takes in what it hears.
        first: place of the mission's first UAV in the beliefs.

    Returns:
        The UAVs that it has heard since its last decision, as bits.
    """
    beacon_until(link, briefing, mission, airwaves, beliefs, first, time_s)
    in_touch = contacts(briefing, mission, uav, time_s)
    for other in range(briefing.n_uavs):
        if in_touch >> other & 1:
            hear_until(mission, airwaves, beliefs, first, other, time_s)
            send(link, briefing, mission, airwaves, other, 1 << uav, time_s)
    hear_until(mission, airwaves, beliefs, first, uav, time_s)
    heard = 0
    for other in range(briefing.n_uavs):
        pair = uav * briefing.n_uavs + other
        heard |= airwaves.is_new[pair] << other
        airwaves.is_new[pair] = 0
    return heard


@kernel
def speak(
    link: Link,
    briefing: Briefing,
    mission: Mission,
    airwaves: Airwaves,
    belief: Belief,
    uav: int,
    time_s: float,
) -> None:
    """Let the deciding UAV send all in contact what it knows now.

    Args:
        belief: what its radio keeps, with what it has just seen.
    """
    n_cells = len(belief.complete)
    for cell in range(n_cells):
        place = uav * n_cells + cell
        if belief.complete[cell] == 1 and airwaves.learned[place] == _NOT_LEARNED:
            airwaves.learned[place] = airwaves.n_sent[0]
    airwaves.decision[uav] = mission.n_decisions[uav]
    in_touch = contacts(briefing, mission, uav, time_s)
    send(link, briefing, mission, airwaves, uav, in_touch, time_s)


@kernel
def beacon_until(
    link: Link,
    briefing: Briefing,
    mission: Mission,
    airwaves: Airwaves,
    beliefs: Beliefs,
    first: int,
    time_s: float,
) -> None:
    """Let all UAVs that fly send what they know at each beacon period until a time."""
    if link.beacon_period_s <= 0.0:
        return
    while (airwaves.n_beacons[0] + 1) * link.beacon_period_s <= time_s:
        airwaves.n_beacons[0] += 1
        beacon_s = airwaves.n_beacons[0] * link.beacon_period_s
        for uav in range(briefing.n_uavs):
            if not has_landed(mission, uav, beacon_s):
                hear_until(mission, airwaves, beliefs, first, uav, beacon_s)
                in_touch = contacts(briefing, mission, uav, beacon_s)
                send(link, briefing, mission, airwaves, uav, in_touch, beacon_s)


@kernel
def send(
    link: Link,
    briefing: Briefing,
    mission: Mission,
    airwaves: Airwaves,
    uav: int,
    receivers: int,
    time_s: float,
) -> None:
    """Send what a UAV's radio keeps to some others, as bits, unless it is still sending."""
    if airwaves.busy_until_s[uav] > time_s or receivers == 0:
        return
    airwaves.busy_until_s[uav] = time_s + link.airtime_s
    airwaves.n_sent[0] += 1
    n_uavs = len(mission.phase)
    for receiver in range(n_uavs):
        if receivers >> receiver & 1:
            _send_to(link, briefing, mission, airwaves, uav, receiver, time_s)


@kernel
def _send_to(
    link: Link,
    briefing: Briefing,
    mission: Mission,
    airwaves: Airwaves,
    uav: int,
    receiver: int,
    time_s: float,
) -> None:
    pair = receiver * len(mission.phase) + uav
    drawn = airwaves.n_drawn[pair]
    airwaves.n_drawn[pair] += 1
    words = draw_words(mission.seed[0], UAV_RADIO, receiver, uav, drawn)
    is_lost = uniform_of(words[0], words[1]) < link.loss_share
    if is_lost or airwaves.n_under_way[pair] == MOST_UNDER_WAY:
        return
    delay_s = link.delay_s + link.jitter_s * (2.0 * uniform_of(words[2], words[3]) - 1.0)
    place = pair * MOST_UNDER_WAY + airwaves.n_under_way[pair]
    airwaves.n_under_way[pair] += 1
    airwaves.number[place] = airwaves.n_sent[0]
    airwaves.sent_s[place] = time_s
    airwaves.arrives_s[place] = time_s + link.airtime_s + delay_s
    x_m, y_m = place_at(briefing, mission, uav, time_s)
    airwaves.x_m[place] = x_m
    airwaves.y_m[place] = y_m
    airwaves.sent_decision[place] = airwaves.decision[uav]


@kernel
def hear_until(
    mission: Mission, airwaves: Airwaves, beliefs: Beliefs, first: int, uav: int, time_s: float
) -> None:
    """Let a UAV's radio take in what has arrived by a time; a silent one hears no more."""
    n_uavs = len(airwaves.busy_until_s)
    belief = belief_of(beliefs, first + uav)
    deaf_from_s = mission.fault_s[SILENT * n_uavs + uav]
    for sender in range(n_uavs):
        pair = uav * n_uavs + sender
        if airwaves.n_under_way[pair] > 0 and _take_arrived(airwaves, pair, time_s, deaf_from_s):
            _learn(airwaves, belief, uav, sender)


@kernel
def _take_arrived(airwaves: Airwaves, pair: int, time_s: float, deaf_from_s: float) -> bool:
    """Take what has arrived off the air; whether it is newer than all before."""
    is_newer = False
    place = pair * MOST_UNDER_WAY
    last = place + airwaves.n_under_way[pair] - 1
    while place <= last:
        if airwaves.arrives_s[place] > time_s or airwaves.arrives_s[place] >= deaf_from_s:
            place += 1
            continue
        if airwaves.number[place] > airwaves.heard_number[pair]:
            is_newer = True
            airwaves.heard_number[pair] = airwaves.number[place]
            airwaves.heard_s[pair] = airwaves.sent_s[place]
            airwaves.heard_x_m[pair] = airwaves.x_m[place]
            airwaves.heard_y_m[pair] = airwaves.y_m[place]
            airwaves.heard_decision[pair] = airwaves.sent_decision[place]
            airwaves.is_new[pair] = 1
        airwaves.number[place] = airwaves.number[last]
        airwaves.sent_s[place] = airwaves.sent_s[last]
        airwaves.arrives_s[place] = airwaves.arrives_s[last]
        airwaves.x_m[place] = airwaves.x_m[last]
        airwaves.y_m[place] = airwaves.y_m[last]
        airwaves.sent_decision[place] = airwaves.sent_decision[last]
        last -= 1
    airwaves.n_under_way[pair] = last - pair * MOST_UNDER_WAY + 1
    return is_newer


@kernel
def _learn(airwaves: Airwaves, belief: Belief, uav: int, sender: int) -> None:
    """Merge the newest message of a sender, as `belief.hear` does."""
    n_cells, pair = len(belief.complete), uav * len(airwaves.busy_until_s) + sender
    for cell in range(n_cells):
        is_sent = airwaves.learned[sender * n_cells + cell] < airwaves.heard_number[pair]
        if is_sent and belief.complete[cell] == 0:
            belief.complete[cell] = 1
            belief.n_complete[0] += 1
            airwaves.learned[uav * n_cells + cell] = airwaves.n_sent[0]
    if airwaves.heard_s[pair] >= belief.peer_s[sender]:
        belief.peer_x_m[sender] = airwaves.heard_x_m[pair]
        belief.peer_y_m[sender] = airwaves.heard_y_m[pair]
        belief.peer_s[sender] = airwaves.heard_s[pair]


def heard_map(airwaves: Airwaves, uav: int, sender: int, n_cells: int) -> Sequence[int]:
    """The map in the newest message that a UAV has heard of another, (C,)."""
    number = airwaves.heard_number[uav * len(airwaves.busy_until_s) + sender]
    learned = airwaves.learned
    return [int(learned[sender * n_cells + cell] < number) for cell in range(n_cells)]
