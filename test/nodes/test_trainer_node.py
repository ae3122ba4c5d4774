"""The trainer node beside worlds and agents: what they fly is what it learns, whoever dies."""

from pathlib import Path
import re
import signal
from typing import Any

from episodes import single_threaded_torch
from fleets import listener
from processes import Processes, wait_until
import pytest
from reports import same
from uav_collect.training.run_record import read_columns, read_run
from uav_collect.uav.policy_file import load_policy

torch = single_threaded_torch()
pytest.importorskip('rclpy')
from rclpy.qos import DurabilityPolicy, QoSProfile
from trainings import (
    fleet_of,
    in_process,
    NEVER,
    PACE,
    replayed,
    SCENARIO,
    start_fleet,
    start_trainer,
    TRAINED_S,
)
from uav_collect.errors import (
    CheckpointError,
    ConfigError,
    PolicyMismatchError,
    TrainingRunError,
)
from uav_collect.learning.fleet_source import FleetSource
from uav_collect.learning.loop import open_trainer
from uav_collect.nodes import topics
from uav_collect.nodes.trainer.settings import PARAMETERS, planned_run, TrainerSettings
from uav_collect.training.folder import open_training_folder
from uav_collect.training.progress import Budget
from uav_collect.uav.briefing import brief
from uav_collect_msgs.msg import Epoch

pytestmark = [pytest.mark.ros, pytest.mark.long]

N_LEARNED = 400  # decisions
WORLD_SEEDS = 10**6  # of its missions, that a world has to itself
N_LOST = 25_000
BRIEF = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


def test_what_is_learned_over_ros_and_from_a_bag_is_what_is_learned_in_one_process(
    processes: Processes, tmp_path: Path
) -> None:
    # The first policy flies all missions, so that they can be flown again. They are some more than
    # it takes, and fewer than would make a late learner leave out updates.
    fleet = fleet_of(processes, tmp_path)
    recorder = fleet.start_recorder()
    given: Any = {'decisions': N_LEARNED, 'publish_every_updates': NEVER}
    live = start_trainer(processes, tmp_path / 'live', **given)
    world = start_fleet(fleet, missions=N_LEARNED // 9, seed=100)
    assert live.wait_for_exit(TRAINED_S) == 0
    seeds = check_learned_alike(tmp_path / 'live')
    assert ' missions joined' in live.output
    assert ' dropped: ' not in live.output
    # As much as the trainer needs is in the bag when the world is done.
    assert world.wait_for_exit(TRAINED_S) == 0
    recorder.send(signal.SIGINT)
    assert recorder.wait_for_exit() == 0
    bag = '--from-bag', str(fleet.bag)
    again = start_trainer(processes, tmp_path / 'again', *bag, decisions=N_LEARNED)
    assert again.wait_for_exit(TRAINED_S) == 0
    assert check_learned_alike(tmp_path / 'again') == sorted(seeds)


def check_learned_alike(run: Path) -> list[int]:
    """What a training has learned is what one process learns of the same missions.

    Returns:
        Their seeds in the order in which they came: one of which a packet was lost comes later.
    """
    episodes, state = replayed(run)
    seeds = [one.mission_seed for one in episodes]
    expected, trainer = in_process(seeds, Budget(decisions=N_LEARNED))
    assert state['learner']['n_updates'] == trainer.n_updates >= 18
    assert len(episodes) > 24
    for one, other in zip(episodes, expected, strict=True):
        assert same(one, other) == []
    learned = load_policy(run / 'last.safetensors')
    assert learned.digest == trainer.snapshot().digest
    return seeds


def n_updates(folder: Path) -> int:
    """How many updates a training has recorded."""
    file = folder / 'progress.csv'
    found = read_columns(file, ('n_updates',))['n_updates'] if file.exists() else ()
    return int(found[-1]) if len(found) else 0


def wait_for_updates(folder: Path, n_wanted: int) -> None:
    """Wait until a training has made so many updates."""
    wait_until(lambda: n_updates(folder) >= n_wanted, TRAINED_S)


@pytest.mark.nightly
def test_a_trainer_that_is_stopped_or_killed_goes_on_from_where_it_was_saved(
    processes: Processes, tmp_path: Path
) -> None:
    fleet, folder = fleet_of(processes, tmp_path), tmp_path / 'run'
    world = start_fleet(fleet)
    given: Any = {'decisions': 10**6, 'checkpoint_period_s': 0.2}
    saved, seen = folder / 'checkpoint' / 'state.pt', 0
    for number in (signal.SIGINT, signal.SIGKILL):
        trainer = start_trainer(processes, folder, **given)
        wait_for_updates(folder, seen + 3)
        if number == signal.SIGINT:
            trainer.send(number)
            assert trainer.wait_for_exit(TRAINED_S) == 0
            assert re.search('decisions; saved(, no .*)?; start it again to go on', trainer.output)
        else:
            wait_until(saved.exists)
            trainer.kill()
        world.wait_for('mission .* ended')  # the fleet flies on
        _, state = replayed(folder)
        assert state['learner']['n_updates'] >= seen
        seen = state['learner']['n_updates']
    n_decisions = state['sources'][0]['n_decisions'] + 100
    trainer = start_trainer(processes, folder, **{**given, 'decisions': n_decisions})
    assert trainer.wait_for_exit(TRAINED_S) == 0
    assert read_run(folder).is_done
    episodes, state = replayed(folder)
    assert state['sources'][0]['n_decisions'] >= n_decisions
    seeds = [one.mission_seed for one in episodes]
    assert len(seeds) == len(set(seeds))  # none was learned from twice
    rows = read_columns(folder / 'progress.csv', ('n_decisions',))['n_decisions']
    assert (rows[1:] >= rows[:-1]).all()
    assert not [*folder.rglob('*.part')]


@pytest.mark.nightly
def test_agents_and_worlds_that_die_cost_their_mission_and_no_more_beside_another_world(
    processes: Processes, tmp_path: Path
) -> None:
    # One fleet may have flown hundreds of missions when the other takes off.
    folder, fleet = tmp_path / 'run', fleet_of(processes, tmp_path, 'a')
    trainer = start_trainer(
        processes, folder, worlds='[a, b]', decisions=10**6, checkpoint_period_s=0.2
    )
    agents = fleet.start_agents('topic', 'equal')
    world = fleet.start_world(missions=-1, real_time_factor=PACE)
    start_fleet(fleet_of(processes, tmp_path, 'b'), seed=WORLD_SEEDS)
    wait_until(lambda: worlds_learned_from(folder) == {0, 1}, TRAINED_S)
    agents[0].kill()
    seen = n_updates(folder)
    fleet.start_agent(1, 'topic', 'equal')
    wait_for_updates(folder, seen + 4)
    world.kill()
    again = {'seed': 2 * WORLD_SEEDS, 'output_dir': tmp_path / 'again'}
    fleet.start_world(missions=-1, real_time_factor=PACE, **again)
    # What the first world flew waits in line for the learner, who takes it first.
    wait_until(lambda: 2 in worlds_learned_from(folder), TRAINED_S)
    trainer.send(signal.SIGINT)
    assert trainer.wait_for_exit(TRAINED_S) == 0
    assert ' refused' not in trainer.output


def worlds_learned_from(folder: Path) -> set[int]:
    """The worlds, by the seeds that each has, whose missions a training has saved."""
    if not (folder / 'checkpoint' / 'state.pt').exists():
        return set()
    episodes, _ = replayed(folder)
    return {one.mission_seed // WORLD_SEEDS for one in episodes}


def test_a_trainer_has_saved_what_it_publishes_and_stops_though_messages_never_reach_it(
    processes: Processes, tmp_path: Path
) -> None:
    # Its history of one message is full before the trainer has asked for any: most are lost. A
    # middleware that is asked to say so may stand still for ever (ros2/rmw_fastrtps#890).
    with listener(topics.POLICY) as flooding:
        trainer = start_trainer(processes, tmp_path / 'run', checkpoint_period_s=1000.0)
        flooding.wait_until(lambda: len(flooding.heard[topics.POLICY.name]) > 0)
        assert (tmp_path / 'run' / 'checkpoint' / 'state.pt').is_file()
        epochs = flooding.node.create_publisher(Epoch, topics.EPOCH.name, BRIEF)
        flooding.wait_until(lambda: epochs.get_subscription_count() > 0)
        for number in range(N_LOST):
            epochs.publish(Epoch(mission_id='flood-0', event=number, uav=1))
    trainer.wait_for('waiting for missions')
    trainer.send(signal.SIGINT)
    assert trainer.wait_for_exit(TRAINED_S) == 0


def test_what_agents_encode_otherwise_is_refused_and_named(
    processes: Processes, tmp_path: Path
) -> None:
    fleet = fleet_of(processes, tmp_path)
    trainer = start_trainer(processes, tmp_path / 'run')
    fleet.start_agents('random', observation_layout='paper')
    fleet.start_world(missions=3)
    trainer.wait_for(r"refused: .* layout is 'paper/1': must be 'egocentric/\d'; its mission")
    trainer.send(signal.SIGINT)
    assert trainer.wait_for_exit(TRAINED_S) == 0
    assert 'stopped before a mission was flown' in trainer.output


def test_what_cannot_be_trained_is_said_in_one_line(processes: Processes, tmp_path: Path) -> None:
    trainer = start_trainer(processes, tmp_path / 'run', '--from-bag', 'nowhere')
    assert trainer.wait_for_exit() == 2
    assert 'nowhere: no such bag' in trainer.output.splitlines()[-1]
    assert 'Traceback' not in trainer.output


@pytest.mark.parametrize(
    ('worlds', 'words'),
    [
        ('[a, 1b]', "worlds has '1b': must be ROS names, as a or north/a"),
        ('[1, 2]', "parameter 'worlds' to '[1, 2]' of type 'INTEGER_ARRAY'"),
    ],
)
def test_worlds_that_cannot_be_are_named_and_no_run_is_begun(
    worlds: str, words: str, processes: Processes, tmp_path: Path
) -> None:
    trainer = start_trainer(processes, tmp_path / 'run', worlds=worlds)
    assert trainer.wait_for_exit() == 2
    *_, line = trainer.output.splitlines()
    assert line.startswith('error: ')
    assert words in line
    assert 'Traceback' not in trainer.output
    assert not (tmp_path / 'run').exists()


def settings_of(folder: Path, **values: object) -> TrainerSettings:
    defaults = {parameter.name: parameter.default for parameter in PARAMETERS}
    file = folder.parent / 'tiny.yaml'
    file.write_text(SCENARIO.to_yaml())
    given = {'scenario': str(file), 'output_dir': str(folder), **values}
    return TrainerSettings(**{**defaults, **given})  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ('values', 'words'),
    [
        ({'algorithm': 'vdn'}, "algorithm is 'vdn': must be aqmix or aiql"),
        ({'algorithm': 'qmix'}, "algorithm is 'qmix': must be aqmix or aiql"),
        ({'output_dir': ''}, 'output_dir is missing: must be a folder for the run'),
        ({'minutes': 3.0, 'decisions': 5}, 'minutes and decisions are given: must be one'),
        ({'scenario': 'nowhere'}, "scenario is 'nowhere'"),
        ({'overrides': ['target.trace=2']}, 'target.trace'),
        ({'start_from': 'none.safetensors'}, 'none.safetensors: cannot be read'),
    ],
)
def test_settings_that_make_no_run_are_refused_and_named(
    values: dict[str, object], words: str, tmp_path: Path
) -> None:
    with pytest.raises((TrainingRunError, ConfigError, PolicyMismatchError), match=words):
        planned_run(settings_of(tmp_path / 'run', **values))


def test_a_run_is_gone_on_with_as_it_was_begun_and_for_as_long_as_is_asked(
    tmp_path: Path,
) -> None:
    folder = tmp_path / 'run'
    begun = planned_run(settings_of(folder, minutes=5.0))
    with open_training_folder(begun, 0, lambda: None):
        pass
    again = planned_run(settings_of(folder, decisions=7))
    assert (again.record.minutes, again.record.decisions) == (None, 7)
    assert again.record.started == begun.record.started
    for values, words in (
        ({'seed': 1}, 'holds a run whose seed is 0: must be 1, or choose another output_dir'),
        ({'decisions_per_update': 20}, 'holds a run whose training_fingerprint is'),
        ({'algorithm': 'aiql'}, "holds a run whose algorithm is 'aqmix': must be 'aiql'"),
    ):
        with pytest.raises(TrainingRunError, match=words):
            planned_run(settings_of(folder, **values))


def test_a_folder_of_something_else_is_no_place_for_a_run(tmp_path: Path) -> None:
    (tmp_path / 'run').mkdir()
    (tmp_path / 'run' / 'thesis.tex').touch()
    with pytest.raises(TrainingRunError, match='holds something else'):
        planned_run(settings_of(tmp_path / 'run'))


@pytest.mark.parametrize('name', ['policy.safetensors', 'progress.csv', 'validation.csv'])
def test_what_a_run_left_without_its_record_is_not_written_over(name: str, tmp_path: Path) -> None:
    folder = tmp_path / 'run'
    with open_training_folder(planned_run(settings_of(folder)), 0, lambda: None):
        pass
    (folder / name).touch()
    (folder / 'run.json').unlink()
    with pytest.raises(TrainingRunError, match=f'{folder}: holds .* of a run, but no run.json'):
        planned_run(settings_of(folder))


def test_a_run_without_its_checkpoint_is_not_begun_anew(tmp_path: Path) -> None:
    folder = tmp_path / 'run'
    with open_training_folder(planned_run(settings_of(folder)), 0, lambda: None):
        pass
    with pytest.raises(CheckpointError, match=r'run/checkpoint/state\.pt: is missing'):
        open_trainer(planned_run(settings_of(folder)), [FleetSource(brief(SCENARIO), NEVER)])


def test_a_disk_that_fills_up_ends_the_training_with_one_line(
    processes: Processes, tmp_path: Path
) -> None:
    start_fleet(fleet_of(processes, tmp_path))
    # No file may have more than 20 blocks: a checkpoint has.
    limited = start_trainer(processes, tmp_path / 'run', checkpoint_period_s=0.1, n_blocks=20)
    assert limited.wait_for_exit(TRAINED_S) == 1
    assert f'{tmp_path}/run/checkpoint/state.pt: File too large' in limited.output
    assert 'Traceback' not in limited.output
