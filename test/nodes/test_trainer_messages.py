"""What a trainer makes of messages that are no live mission's: it learns on, and not from them."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
import random
import signal
from typing import Any

from episodes import single_threaded_torch
from fleets import listener
from processes import DEADLINE_S, Processes
import pytest

torch = single_threaded_torch()
pytest.importorskip('rclpy')
from rclpy.duration import Duration
from rclpy.serialization import serialize_message
from trainings import fleet_of, replayed, start_fleet, start_trainer, TRAINED_S
from uav_collect.nodes import topics
from uav_collect.nodes.topics import publisher, Topic

pytestmark = [pytest.mark.ros, pytest.mark.long]

N_FLOWN = 12  # missions before the training
FIRST_LIVE = 10**6  # mission seed
N_MUTATED = 400  # messages on each topic
WORLD, UAVS = topics.world_topics(), (topics.uav_topics(1), topics.uav_topics(2))
REPORTING = (WORLD.scenario, WORLD.mission, WORLD.epoch, *(uav.transition for uav in UAVS))

Heard = dict[str, list[Any]]


def flown(processes: Processes, folder: Path, n_missions: int) -> Heard:
    """The messages of missions whose world is gone, by topic."""
    fleet = fleet_of(processes, folder)
    with listener(*REPORTING) as listening:
        agents = fleet.start_agents('random', 'equal', observation_layout='egocentric')
        world = fleet.start_world(missions=n_missions, output_dir=folder / 'flown')
        missions = listening.heard[WORLD.mission.name]
        listening.wait_until(lambda: len(missions) == 2 * n_missions)
        epochs = listening.heard[WORLD.epoch.name]
        listening.wait_until(lambda: sum(epoch.terminal for epoch in epochs) == n_missions)
        reported = [listening.heard[uav.transition.name] for uav in UAVS]
        listening.wait_until(lambda: sum(map(len, reported)) == len(epochs))
    for process in (world, *agents):
        process.kill()
    return listening.heard


@contextmanager
def published(heard: Heard, *reporting: Topic) -> Iterator[dict[str, Any]]:
    """Publishers on topics, each with a reader, by the topic's name."""
    with listener() as playing:
        made = {topic.name: publisher(playing.node, topic) for topic in reporting}
        readers = made.values()
        playing.wait_until(lambda: all(it.get_subscription_count() > 0 for it in readers))
        yield made


@pytest.mark.nightly
def test_of_missions_played_back_while_a_fleet_flies_none_is_learned_from(
    processes: Processes, tmp_path: Path
) -> None:
    heard = flown(processes, tmp_path, N_FLOWN)
    trainer = start_trainer(processes, tmp_path / 'run', decisions=10**6)
    trainer.wait_for('waiting for missions')
    start_fleet(fleet_of(processes, tmp_path), seed=FIRST_LIVE)
    with published(heard, *REPORTING) as players:
        for topic, player in players.items():
            for message in heard[topic]:
                player.publish(message)
        trainer.wait_for(f' {N_FLOWN} foreign', TRAINED_S)
    assert ' refused' not in trainer.output
    trainer.wait_for(r'loss \d', TRAINED_S)
    trainer.send(signal.SIGINT)
    assert trainer.wait_for_exit(TRAINED_S) == 0
    episodes, _ = replayed(tmp_path / 'run')
    assert len(episodes) > 0
    assert min(one.mission_seed for one in episodes) >= FIRST_LIVE


@pytest.mark.nightly
def test_of_missions_of_a_world_that_does_not_answer_none_is_learned_from(
    processes: Processes, tmp_path: Path
) -> None:
    heard = flown(processes, tmp_path, n_missions=5)
    trainer = start_trainer(processes, tmp_path / 'run')
    trainer.wait_for('waiting for missions')
    with published(heard, *REPORTING) as players:
        for topic, player in players.items():
            for message in heard[topic]:
                player.publish(message)
        trainer.wait_for('0 missions joined, .* 5 foreign')


def mutated(message: Any, rng: random.Random) -> bytes:  # noqa: ANN401
    """A message with some bytes changed, cut off or added, or nothing like it.

    It has four bytes at least: less than a header the middleware does not deliver.
    """
    content = bytearray(serialize_message(message))
    match rng.randrange(5):
        case 0:
            return rng.randbytes(rng.randrange(4, 200))
        case 1:
            return bytes(content[: rng.randrange(4, len(content))])
        case 2:
            place = rng.randrange(len(content))
            content[place:place] = rng.randbytes(rng.randint(1, 8))
        case 3:
            for _ in range(rng.randint(1, 8)):
                content[rng.randrange(len(content))] = rng.randrange(256)
        case _:
            place = rng.randrange(len(content))
            content[place : place + 8] = rng.choice((b'\xff' * 8, b'\x00' * 8, b'\x7f' * 8))
    return bytes(content)


def test_no_message_however_broken_ends_a_trainer(processes: Processes, tmp_path: Path) -> None:
    heard = flown(processes, tmp_path, n_missions=3)
    trainer = start_trainer(processes, tmp_path / 'run', decisions=200)
    trainer.wait_for('waiting for missions')
    rng = random.Random(0)
    with published(heard, *REPORTING) as senders:
        for topic, sender in senders.items():
            for _ in range(N_MUTATED):
                sender.publish(mutated(rng.choice(heard[topic]), rng))
            assert sender.wait_for_all_acked(Duration(seconds=DEADLINE_S))
        trainer.wait_for('waiting for missions')
    start_fleet(fleet_of(processes, tmp_path), seed=FIRST_LIVE)
    assert trainer.wait_for_exit(TRAINED_S) == 0
    assert 'Traceback' not in trainer.output
    assert max(map(len, trainer.output.splitlines())) < 1_000
    episodes, _ = replayed(tmp_path / 'run')
    assert {one.mission_seed >= FIRST_LIVE for one in episodes} == {True}
