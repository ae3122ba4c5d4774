"""Training as a whole: the same run every time, stopped half way or not."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from pathlib import Path

from episodes import single_threaded_torch, small
import numpy as np
import pytest
from tiny_world import tiny, uav
from uav_collect.errors import PolicyMismatchError
from uav_collect.learning.replay import Replay, replay_bytes
from uav_collect.missions.experience import Episode
from uav_collect.missions.rollout import fly
from uav_collect.scenario.model import Scenario
from uav_collect.scenario.site import build_site
from uav_collect.training.config import TrainingConfig
from uav_collect.uav.learned_on import learned_on
from uav_collect.uav.policy_network import LearnedPolicy

torch = single_threaded_torch()
from trainer_states import differences, state_of
from uav_collect.errors import ConfigError
from uav_collect.learning import trainer as trainer_module
from uav_collect.learning.saved import SavedPart
from uav_collect.learning.trainer import Trainer
from uav_collect.training.progress import Budget, Progress, SpeedMeter
from uav_collect.uav.briefing import brief

DECISIONS = 1000
BUDGET = Budget(decisions=DECISIONS)
FLEET = uav(5.0, energy_budget_kj=25.0), uav(10.0, energy_budget_kj=12.0)


def trainer_of(
    algorithm: str = 'aqmix',
    seed: int = 0,
    scenarios: Sequence[Scenario] | None = None,
    config: TrainingConfig | None = None,
) -> Trainer:
    scenarios = scenarios or [tiny(*FLEET)]
    return Trainer(scenarios, config or small('strong'), algorithm, seed)


def trained(trainer: Trainer, budget: Budget = BUDGET) -> list[Progress]:
    return list(trainer.run(budget))


@dataclass(frozen=True, kw_only=True)
class Finished:
    """A training that is over, and how it went."""

    trainer: Trainer
    progress: list[Progress]


@cache
def finished_by(algorithm: str) -> Finished:
    """The training of seed 0 by an algorithm, which tests look at and none goes on with."""
    trainer = trainer_of(algorithm)
    return Finished(trainer=trainer, progress=trained(trainer))


@pytest.fixture
def finished() -> Finished:
    return finished_by('aqmix')


def loaded(folder: Path, trainer: Trainer | None = None) -> Trainer:
    """A new trainer that goes on from what another one saved."""
    trainer = trainer or trainer_of()
    trainer.load(folder)
    return trainer


@pytest.mark.parametrize('algorithm', ['aqmix', 'qmix', 'aiql'])
def test_a_run_that_stopped_half_way_ends_as_the_one_that_went_on(
    algorithm: str, tmp_path: Path
) -> None:
    straight, stopped = finished_by(algorithm).trainer, trainer_of(algorithm)
    for progress in stopped.run(BUDGET):
        if progress.n_decisions >= DECISIONS // 2:
            break
    assert stopped.n_decisions < DECISIONS
    assert stopped.n_updates > 0
    stopped.save(tmp_path / 'half')
    resumed = loaded(tmp_path / 'half', trainer_of(algorithm))
    trained(resumed)
    one, other = state_of(straight, tmp_path / 'one'), state_of(resumed, tmp_path / 'other')
    assert differences(one, other) == []
    assert one['learner']['n_updates'] > stopped.n_updates


def test_a_validation_that_is_broken_off_is_made_by_who_goes_on(
    finished: Finished, tmp_path: Path
) -> None:
    stopped = trainer_of()
    asked: list[int] = []

    def is_stopped() -> bool:  # asked within validations alone
        asked.append(stopped.n_updates)
        return len(asked) > 3

    broken_off = next(it for it in stopped.run(BUDGET, is_stopped) if asked)
    assert (broken_off.validation, broken_off.best) == (None, None)
    stopped.save(tmp_path / 'stopped')
    resumed = loaded(tmp_path / 'stopped', trainer_of())
    assert trained(resumed)[0].validation is not None
    one, other = (
        state_of(finished.trainer, tmp_path / 'one'),
        state_of(resumed, tmp_path / 'other'),
    )
    assert differences(one, other) == []


def test_a_run_over_several_areas_and_fleets_is_resumed_alike(tmp_path: Path) -> None:
    scenarios = tiny(*FLEET), tiny(*FLEET, uav(7.5, energy_budget_kj=20.0), area__cells_per_side=5)
    straight = trainer_of(scenarios=scenarios)
    trained(straight)
    stopped = trainer_of(scenarios=scenarios)
    next(it for it in stopped.run(BUDGET) if it.n_decisions >= DECISIONS // 2)
    stopped.save(tmp_path / 'half')
    resumed = loaded(tmp_path / 'half', trainer_of(scenarios=scenarios))
    trained(resumed)
    one, other = state_of(straight, tmp_path / 'one'), state_of(resumed, tmp_path / 'other')
    assert differences(one, other) == []


@pytest.mark.parametrize('every', ['missions', 'updates'])
def test_wherever_a_run_stops_it_ends_as_the_one_that_went_on(
    every: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Once epsilon is low an update takes more missions than there are: some turns make none.
    settings = {
        'rollout__decisions_per_update': 20, 'replay__missions_per_batch_first': 1,
        'replay__missions_per_batch': 12, 'exploration__decay_share': 0.4,
        f'validation__every_{every}': 2,
    }  # fmt: skip
    config, budget = small('strong', **settings), Budget(decisions=500)
    monkeypatch.setattr(SpeedMeter, 'is_due', lambda meter: True)  # a look after every turn
    straight, looks = trainer_of(config=config), []
    for progress in straight.run(budget):
        straight.save(tmp_path / str(len(looks)))
        looks.append(progress)
    n_updates = [it.n_updates for it in looks]
    assert any(n == after > 0 for n, after in pairwise(n_updates))
    wanted = state_of(straight, tmp_path / 'straight')
    for look in range(1, len(looks), 2):
        resumed = loaded(tmp_path / str(look), trainer_of(config=config))
        later = trained(resumed, budget)
        assert validated(later) == validated(looks[look + 1 :])
        assert differences(wanted, state_of(resumed, tmp_path / 'resumed')) == []


def validated(looks: Sequence[Progress]) -> list[tuple[int, float]]:
    """After how many updates there was a validation, and how well its policy flew."""
    validations = [it.validation for it in looks if it.validation is not None]
    return [(it.n_updates, it.efficiency_kbit_per_j) for it in validations]


def papers_loop(**overrides: object) -> TrainingConfig:
    """One mission at a time, an update at every event, a validation after every two missions."""
    settings = {
        'replay__sequence_decisions': 3, 'replay__burn_in_decisions': 2,
        'replay__missions_per_batch': 2, 'rollout__missions_at_once': 1,
        'rollout__decisions_per_update': 1, 'validation__every_missions': 2,
    }  # fmt: skip
    return small('paper', **settings | overrides)


@pytest.mark.parametrize('algorithm', ['aqmix', 'qmix', 'aiql'])
def test_the_papers_loop_updates_at_every_event_and_is_resumed_alike(
    algorithm: str, tmp_path: Path
) -> None:
    budget, longest = Budget(decisions=120), papers_loop().max_decisions(16)
    straight, stopped = (trainer_of(algorithm, config=papers_loop()) for _ in range(2))
    progress = trained(straight, budget)
    assert 120 - longest - 1 <= straight.n_updates < straight.n_decisions == 120
    assert np.isfinite([progress[-1].mean_value, progress[-1].gradient_norm]).all()
    validated = [it.n_missions for it in progress if it.validation is not None]
    assert [it // 2 for it in validated[:-1]] == [*range(1, len(validated))]
    next(it for it in stopped.run(budget) if it.validation is not None)
    stopped.save(tmp_path / 'half')
    resumed = loaded(tmp_path / 'half', trainer_of(algorithm, config=papers_loop()))
    trained(resumed, budget)
    one, other = state_of(straight, tmp_path / 'one'), state_of(resumed, tmp_path / 'other')
    assert differences(one, other) == []


def test_updates_wait_for_the_decisions_that_are_to_be_held_first() -> None:
    trainer = trainer_of(config=papers_loop(replay__decisions_before_updates=100))
    trained(trainer, Budget(decisions=99))
    assert trainer.n_updates == 0
    trained(trainer, Budget(decisions=150))
    assert 0 < trainer.n_updates <= 51
    with pytest.raises(ConfigError, match='decisions_before_updates is 1,990: must be at most 1,'):
        trainer_of(config=papers_loop(replay__decisions_before_updates=1990))


def test_saving_changes_nothing_and_a_checkpoint_is_saved_again_alike(
    finished: Finished, tmp_path: Path
) -> None:
    first, second = (state_of(finished.trainer, tmp_path / name) for name in ('first', 'second'))
    again = state_of(loaded(tmp_path / 'first'), tmp_path / 'again')
    assert differences(first, second) == []
    assert differences(first, again) == []


def test_a_resumed_run_has_its_best_policy(finished: Finished, tmp_path: Path) -> None:
    trainer = finished.trainer
    trainer.save(tmp_path)
    before, after = trainer.best_policy(), loaded(tmp_path).best_policy()
    assert before is not None
    assert after is not None
    assert after.header == before.header
    assert differences(dict(before.weights), dict(after.weights)) == []


def test_the_best_policy_of_a_resumed_run_is_of_the_revision_that_found_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(trainer_module, 'git_revision', lambda: 'earlier')
    stopped = trainer_of()
    next(it for it in stopped.run(BUDGET) if it.validation is not None)
    state = stopped.state()
    monkeypatch.setattr(trainer_module, 'git_revision', lambda: 'later')
    resumed, of_old = trainer_of(), trainer_of()
    resumed.restore(SavedPart(state))
    del state['best_revision']  # as 0.1.0 saved it
    of_old.restore(SavedPart(state))
    for trainer, revision in ((resumed, 'earlier'), (of_old, 'unknown')):
        policy = trainer.best_policy()
        assert policy is not None
        assert policy.header.git_revision == revision
    assert resumed.policy().header.git_revision == 'later'


def test_the_same_seed_trains_the_same_policy_and_another_seed_another_one(
    finished: Finished,
) -> None:
    again, another = trainer_of(seed=0), trainer_of(seed=1)
    trained(again)
    trained(another)
    versions = []
    for trainer in (finished.trainer, again, another):
        versions.append(trainer.policy().header.version.split('-')[-1])
    assert versions[0] == versions[1] != versions[2]


def test_it_trains_for_the_decisions_of_its_budget_and_learns_after_each_so_many(
    finished: Finished,
) -> None:
    trainer, progress, config = finished.trainer, finished.progress, small('strong')
    assert DECISIONS <= trainer.n_decisions < DECISIONS + config.rollout.missions_at_once
    assert progress[-1].share_done == 1.0
    assert 0 < trainer.n_updates <= DECISIONS / config.rollout.decisions_per_update
    assert trained(trainer) == []  # the budget is spent


def test_it_validates_every_so_many_updates_and_at_the_end(finished: Finished) -> None:
    validated = [it.n_updates for it in finished.progress if it.validation is not None]
    assert validated[:-1] == list(range(4, validated[-1], 4))
    assert validated[-1] == finished.trainer.n_updates


def test_a_validation_tells_how_the_policy_flies_its_missions(finished: Finished) -> None:
    progress = finished.progress[-1]
    policy, scenario = finished.trainer.policy(), tiny(*FLEET)
    assert progress.validation is not None
    assert policy.header.validation.missions == 2
    assert policy.header.learned_on == (learned_on(scenario),)
    seeds = [2**60, 2**60 + 1]
    learned = LearnedPolicy('it', policy)
    logs = fly(build_site(scenario), seeds, lambda: learned, 'equal', guard_after=0)
    efficiencies = [
        log.events['collected_bit'].sum() / log.events['energy_j'].sum() / 1e3 for log in logs
    ]
    efficiency = progress.validation.efficiency_kbit_per_j
    assert efficiency == policy.header.validation.efficiency_kbit_per_j
    assert efficiency == pytest.approx(np.mean(efficiencies))


def test_the_best_policy_is_the_one_that_validated_best(finished: Finished) -> None:
    validations = [it.validation for it in finished.progress if it.validation is not None]
    best = max(
        validations,
        key=lambda it: (
            min(it.complete_share, it.safe_share, 0.99),
            it.efficiency_kbit_per_j,
            -it.n_updates,
        ),
    )
    policy = finished.trainer.best_policy()
    assert policy is not None
    assert policy.header.updates == best.n_updates
    assert policy.header.validation.efficiency_kbit_per_j == best.efficiency_kbit_per_j


def test_there_is_no_best_policy_before_the_first_validation() -> None:
    assert trainer_of().best_policy() is None


def test_it_learns_with_the_discount_of_its_settings_and_flies_the_scenario_as_it_is() -> None:
    scenario = tiny(*FLEET)
    trainer = trainer_of(scenarios=[scenario])
    assert trainer.scenarios[0].reward.discount_per_s == scenario.reward.discount_per_s == 0.99
    assert trainer.config.reward.discount_per_s == 0.999


@pytest.mark.parametrize('hidden_size', [8, 16])  # by torch; by kernels
def test_what_is_learned_does_not_depend_on_the_memory_for_observations(
    hidden_size: int, tmp_path: Path
) -> None:
    states = []
    for observation_mb in (0, 512):
        sizes = {'network__hidden_size': hidden_size, 'replay__observation_mb': observation_mb}
        trainer = trainer_of(config=small('strong', **sizes))
        trained(trainer)
        states.append(state_of(trainer, tmp_path / str(observation_mb)))
        assert (trainer.replay_bytes > replay_bytes(2000, brief(tiny(*FLEET)))) == bool(
            observation_mb
        )
    assert differences(*states) == ['/settings: ' + ' and '.join(it['settings'] for it in states)]


def test_compiled_a_training_is_the_same_every_time(tmp_path: Path) -> None:
    config = small('strong', network__hidden_size=16)
    states = []
    for turn in range(2):
        trainer = trainer_of(config=config)
        trained(trainer)
        states.append(state_of(trainer, tmp_path / str(turn)))
    assert differences(*states) == []


def test_an_update_takes_fewer_missions_as_long_as_epsilon_falls(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    settings = {'missions_per_batch_first': 2, 'missions_per_batch': 5}
    config = small('strong', **{f'replay__{name}': it for name, it in settings.items()})
    trainer, sizes = trainer_of(config=config), []
    sample = Replay.sample

    def counted(
        replay: Replay, n_missions: int, rng: np.random.Generator, n_decisions: int
    ) -> list[Episode]:
        sizes.append((trainer.share_done(BUDGET), n_missions))
        return sample(replay, n_missions, rng, n_decisions)

    monkeypatch.setattr(Replay, 'sample', counted)
    trained(trainer)
    assert {n_missions for _, n_missions in sizes} == {2, 5}
    # The share counts from before the decisions that were collected for an update.
    share = config.exploration.decay_share
    assert {n_missions for done, n_missions in sizes if done < share} == {2}
    assert {n_missions for done, n_missions in sizes if done > share + 0.1} == {5}


def test_the_replays_bytes_are_announced() -> None:
    trainer = trainer_of()
    assert trainer.replay_bytes == replay_bytes(2000, brief(tiny(*FLEET)))


def test_a_paper_observation_of_several_areas_is_refused() -> None:
    scenarios = tiny(*FLEET), tiny(*FLEET, area__cells_per_side=5)
    with pytest.raises(ConfigError, match="observation is 'paper': must be egocentric"):
        trainer_of(scenarios=scenarios, config=small('paper'))


def test_a_policy_of_another_network_is_no_start() -> None:
    # The paper's observation is as long as the area has cells.
    policy = Trainer([tiny(*FLEET)], small(), 'aqmix', 0).policy()
    larger = tiny(*FLEET, area__cells_per_side=5)
    with pytest.raises(PolicyMismatchError, match=r'observation size is 35: must be 44'):
        Trainer([larger], small(), 'aqmix', 0, initial=policy)
    wider = small(network__hidden_size=9)
    with pytest.raises(PolicyMismatchError, match=r'hidden size is 8: must be 9'):
        Trainer([tiny(*FLEET)], wider, 'aqmix', 0, initial=policy)


@pytest.mark.parametrize(
    ('algorithm', 'setting'),
    [
        ('branches', {'branches__decisions_per_mission': 5.0}),
        ('imitation', {'imitation__teachers': ['nobody'], 'imitation__teacher_share': 0.5}),
    ],
)
def test_settings_that_an_algorithm_cannot_learn_by_are_refused(
    algorithm: str, setting: dict[str, object]
) -> None:
    for settings, what in (
        ({'observation': 'relative'}, f'preset strong: {algorithm} is missing'),
        (setting, "observation is 'egocentric': must be relative to learn by the algorithm"),
    ):
        with pytest.raises(ConfigError, match=what):
            Trainer([tiny()], small('strong', **settings), algorithm, 0)
