"""Messages between UAVs that are lost, late, or too many, over the tiny world.

Both UAVs start in the south-west cell and look there: cells 0, 4 and 5 hold nothing, cell 1 does.
The first moves in 10 s, the second in 5 s.
"""

from dataclasses import replace

import pytest
from tiny_world import Flight, tiny, uav
from uav_collect.errors import ConfigError
from uav_collect.missions.rollout import fly
from uav_collect.missions.simulation import Event
from uav_collect.recording.mission_log import MissionLog
from uav_collect.scenario.load import fingerprint, from_yaml, load
from uav_collect.scenario.model import Scenario
from uav_collect.scenario.site import build_site
from uav_collect.uav.action_codes import FORWARD, HOME, RIGHT
from uav_collect.world.exchange import MOST_UNDER_WAY

SEEDS = [*range(12)]
EVERYWHERE = {'radio.contact_range_m': float('inf')}
MESSAGE_BITS = 232 + 16  # header and a bit for each of 16 cells


def senders(event: Event) -> list[int]:
    return [message.sender for message in event.heard]


def rough(**values: object) -> Flight:
    return Flight(tiny(**{f'radio__{name}': value for name, value in values.items()}))


def logs(scenario: Scenario, policy: str = 'sweep') -> list[MissionLog]:
    return fly(build_site(scenario), SEEDS, policy, 'exact', guard_after=0)


def flown(log: MissionLog) -> bytes:
    """What a mission was, but for its header and whom UAVs heard."""
    events = log.events.copy()
    events['heard'] = 0
    return replace(log, events=events).to_jsonl().partition(b'\n')[2]


def test_a_radio_that_loses_nothing_and_is_never_late_changes_no_mission() -> None:
    ideal = logs(load('paper_10x10'))
    perfect = logs(load('paper_10x10', {'radio.loss_share': 0.0, 'radio.delay_s': [0.0, 0.0]}))
    assert [flown(log) for log in perfect] == [flown(log) for log in ideal]


def test_a_radio_that_loses_all_is_one_out_of_range() -> None:
    lost = logs(load('paper_10x10', {'radio.loss_share': 1.0}))
    out_of_range = logs(load('paper_10x10', {'radio.contact_range_m': 0.0}))
    # At its start the fleet stands in one place, which is in range of itself.
    assert all(not log.events['heard'].any() for log in lost)
    after_start = [flown(log).split(b'\n')[2:] for log in out_of_range]
    assert [flown(log).split(b'\n')[2:] for log in lost] == after_start


def test_the_share_of_lost_messages_is_the_scenarios() -> None:
    heard = {
        share: sum(
            int((log.events['heard'] > 0).sum())
            for log in logs(load('paper_10x10', {**EVERYWHERE, 'radio.loss_share': share}), 'hert')
        )
        for share in (0.0, 0.5)
    }
    # A decision hears of the other if its answer came, or a message since: half of a half is lost
    # where the other has decided once meanwhile.
    assert 0.5 < heard[0.5] / heard[0.0] < 0.9


def test_a_message_that_is_late_is_heard_at_the_first_decision_after_it_came() -> None:
    flight = rough(delay_s=[7.0, 0.0])
    assert senders(flight.step(RIGHT)) == []  # of the first UAV, at 0 s
    assert senders(flight.step(FORWARD)) == []  # the second one's at 0 s
    assert senders(flight.step(FORWARD)) == []  # at 5 s: what was sent at 0 s comes at 7 s
    first = flight.step(RIGHT)
    assert (first.uav, first.view.time_s) == (0, 10.0)
    (message,) = first.heard
    assert (message.sender, message.time_s) == (1, 0.0)
    assert (message.x_m, message.y_m) == (25.0, 25.0)


def test_a_late_message_tells_what_its_sender_knew_when_it_was_sent() -> None:
    # The second UAV sees the cells of row 2 at 5 s; what it sent before says nothing of them.
    flight = rough(delay_s=[7.0, 0.0])
    for action in (RIGHT, FORWARD, FORWARD):
        flight.step(action)
    assert flight.known(1) == [0, 4, 5, 8, 9]
    (message,) = flight.look().heard
    assert [cell for cell, known in enumerate(message.complete) if known] == [0, 4, 5]
    assert flight.simulation.known_complete(0)[8] == 0


def test_a_newer_message_that_comes_first_is_not_undone_by_an_older_one() -> None:
    # Delays of 0 to 40 s: messages overtake each other.
    scenario = load('paper_10x10', {'radio.delay_s': [20.0, 20.0], 'radio.beacon_period_s': 1.0})
    flight = Flight(scenario)
    newest: dict[tuple[int, int], float] = {}
    for _ in range(60):
        event = flight.look()
        for message in event.heard:
            pair = (event.uav, message.sender)
            assert message.time_s >= newest.get(pair, -1.0)
            newest[pair] = message.time_s
        legal = [action for action in (FORWARD, RIGHT) if _is_legal(flight, event, action)]
        flight.act(event, legal[0] if legal else HOME)
        if not legal:
            break
    assert len(newest) == 2


def _is_legal(flight: Flight, event: Event, action: int) -> bool:
    flight.agents[event.uav].decide(event.view)
    return flight.agents[event.uav].legal[action] == 1


def test_beacons_are_sent_while_nobody_decides() -> None:
    # The first UAV flies until 10 s; without beacons it is silent meanwhile but for its answers.
    flight = rough(delay_s=[3.0, 0.0], beacon_period_s=1.0)
    for action in (RIGHT, FORWARD):
        flight.step(action)
    (message,) = flight.step(FORWARD).heard  # at 5 s
    assert (message.sender, message.time_s, message.x_m) == (0, 2.0, 35.0)


def test_a_radio_that_still_sends_takes_no_other_message() -> None:
    # A message takes 6 s to send: that at 0 s is through at 6 s, that at 5 s is never sent.
    flight = rough(rate_bps=MESSAGE_BITS / 6.0)
    for action in (RIGHT, FORWARD, FORWARD):
        flight.step(action)
    (message,) = flight.step(RIGHT).heard  # of the first UAV, at 10 s
    assert (message.sender, message.time_s) == (1, 0.0)


def test_what_one_pair_of_uavs_hears_is_drawn_whatever_the_others_say() -> None:
    # The third UAV starts within range of both, or of none.
    def heard(third: tuple[int, int]) -> list[list[int]]:
        fleet = [uav(5.0), uav(10.0), uav(5.0, start=third)]
        reach = {'radio__contact_range_m': 120.0, 'radio__loss_share': 0.5}
        flight = Flight(tiny(*fleet, **reach), seed=3)
        events = [flight.step(FORWARD) for _ in range(7)]
        return [[it for it in senders(event) if it < 2] for event in events if event.uav < 2]

    near, far = heard((0, 0)), heard((0, 3))
    assert near == far
    assert [] in near
    assert near.count([]) < len(near)


def test_no_more_messages_are_under_way_than_there_is_room_for() -> None:
    flight = rough(delay_s=[3600.0, 0.0], beacon_period_s=0.1)
    for action in (RIGHT, FORWARD, FORWARD, RIGHT):
        flight.step(action)
    airwaves = flight.simulation._batch.airwaves
    assert max(airwaves.n_under_way[0]) == MOST_UNDER_WAY


def test_a_radio_that_is_described_makes_another_scenario() -> None:
    described = load('paper_10x10', {'radio.loss_share': 0.0})
    assert fingerprint(described) != fingerprint(load('paper_10x10'))
    assert from_yaml(described.to_yaml()) == described


def test_null_takes_back_what_a_scenario_says_of_its_radio() -> None:
    keys = ('radio.loss_share', 'radio.delay_s', 'radio.rate_bps', 'radio.beacon_period_s')
    taken_back = load('rough_10x10', {**dict.fromkeys(keys), 'faults': None})
    assert fingerprint(taken_back) == fingerprint(load('paper_10x10'))


@pytest.mark.parametrize(
    ('key', 'value', 'words'),
    [
        ('radio.loss_share', 1.5, r'radio.loss_share is 1.5: must be a number from 0 to 1'),
        ('radio.delay_s', 3.0, r'radio.delay_s is 3.0: must be a list \[mean, jitter\]'),
        ('radio.delay_s', [1.0, 2.0], r'the jitter must be at most the mean'),
        ('radio.rate_bps', 0.0, r'radio.rate_bps is 0.0: must be a number from 1'),
        ('radio.beacon_period_s', 0.01, r'beacon_period_s is 0.01: must be a number from 0.1'),
    ],
)
def test_a_radio_that_cannot_be_is_refused(key: str, value: object, words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        load('paper_10x10', {key: value})
