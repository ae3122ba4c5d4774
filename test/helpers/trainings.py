"""Trainings by the trainer node, and the same ones in this process."""

from collections import deque
from collections.abc import Sequence
from pathlib import Path
import shlex
from typing import Any

from fleets import Fleet, parameters
from processes import DEADLINE_S, executable, Processes, RunningProcess
from reports import MissionSetup
from tiny_world import tiny, uav
from uav_collect.ingest.join import JoinedMission
from uav_collect.learning.checkpoint import read_checkpoint
from uav_collect.learning.fleet_source import FleetSource
from uav_collect.learning.trainer import Trainer
from uav_collect.missions.experience import Episode
from uav_collect.training.config import load_preset, TrainingConfig
from uav_collect.training.progress import Budget
from uav_collect.uav.briefing import brief

SCENARIO = tiny(uav(5.0, energy_budget_kj=9.0), uav(10.0, energy_budget_kj=5.0))
SETTINGS = {
    'network.hidden_size': 8, 'mixer.embedding_size': 4, 'mixer.hypernetwork_size': 6,
    'mixer.pool_side': 2, 'replay.missions_per_batch': 4, 'validation.missions': 2,
    'validation.every_updates': 15, 'rollout.max_decisions_per_cell': 0.6,
    'exploration.epsilon_first': 0.3,
}  # fmt: skip
TRAINED_S = DEADLINE_S  # for what takes ten seconds where nothing else runs
NEVER = 1_000_000  # updates: the first policy flies until the end
PACE = 50.0  # simulated over wall-clock time: some 13 decisions a second


def start_trainer(
    processes: Processes,
    folder: Path,
    *flags: str,
    decisions: int = 1000,
    n_blocks: int | None = None,
    **values: object,
) -> RunningProcess:
    """A trainer of the tiny scenario, its kernels interpreted: a compiler would take minutes.

    Args:
        n_blocks: most that a file of it may take.
    """
    file = folder.parent / 'tiny.yaml'
    file.write_text(SCENARIO.to_yaml())
    overrides = ', '.join(f'{key}={value}' for key, value in SETTINGS.items())
    given = {
        'scenario': file, 'output_dir': folder, 'decisions': decisions,
        'decisions_per_update': 20, 'replay_decisions': 2000, 'overrides': f'[{overrides}]',
    }  # fmt: skip
    command = [str(executable('trainer')), *flags, *parameters(**{**given, **values})]
    if n_blocks is not None:
        command = ['sh', '-c', f'ulimit -f {n_blocks}; exec {shlex.join(command)}']
    return processes.run('trainer', *command, UAV_COLLECT_KERNELS='interpreted')


def fleet_of(processes: Processes, folder: Path, world: str = '') -> Fleet:
    """The tiny scenario's fleet, in the world of a name."""
    return Fleet(processes=processes, scenario=SCENARIO, folder=folder / f'w{world}', world=world)


def start_fleet(fleet: Fleet, missions: int = -1, **values: object) -> RunningProcess:
    """Agents that fly what a trainer publishes, and their world.

    Without an end they fly at a pace: a trainer that starts meanwhile needs the processor.
    """
    fleet.start_agents('topic', 'equal')
    pace = PACE if missions < 0 else 0.0
    unseen = {'viewer_rate_hz': 0.0, 'sample_rate_hz': 0.0}
    return fleet.start_world(missions=missions, real_time_factor=pace, **{**unseen, **values})


def config_of(**values: object) -> TrainingConfig:
    """The settings of such a trainer, or with other values."""
    sizes = {'rollout.decisions_per_update': 20, 'replay.decisions': 2000}
    return load_preset('strong', {**SETTINGS, **sizes, **values})


def replayed(folder: Path, **values: object) -> tuple[list[Episode], dict[str, Any]]:
    """The missions that a saved trainer holds, in the order in which they came; its state.

    Args:
        values: settings of that trainer other than those of `config_of`.
    """
    source = FleetSource(brief(SCENARIO), NEVER)
    trainer = Trainer([SCENARIO], config_of(**values), 'aqmix', 0, sources=[source])
    trainer.load(folder / 'checkpoint')
    replay = trainer._tasks[0].replay
    held = [replay._episode(mission) for mission in replay._missions]
    return held, read_checkpoint(folder / 'checkpoint')


def in_process(seeds: Sequence[int], budget: Budget) -> tuple[list[Episode], Trainer]:
    """What the same network flies and learns in this process."""
    source = FleetSource(brief(SCENARIO), NEVER)
    trainer = Trainer([SCENARIO], config_of(), 'aqmix', 0, sources=[source])
    config, frozen = trainer.config, trainer.snapshot()
    setup = MissionSetup(
        scenario=SCENARIO,
        discount_per_s=config.reward.discount_per_s,
        max_decisions=config.max_decisions(SCENARIO.n_cells),
        flown=frozen,
    )
    episodes = setup.episodes(seeds)
    for episode in episodes:
        source.add(
            JoinedMission(
                mission_id=str(episode.mission_seed), episode=episode, efficiency_kbit_per_j=0.0
            )
        )
    deque(trainer.run(budget), 0)
    return episodes, trainer
