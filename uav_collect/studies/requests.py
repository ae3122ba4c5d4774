"""Collects the jobs that studies ask for: what several of them need is done once."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from uav_collect.scenario.model import Scenario
from uav_collect.studies.jobs.jobs import digest_of, FlightsJob, Job, PlansJob, training_job
from uav_collect.studies.scale import ScaleConfig
from uav_collect.studies.study import (
    AQMIX,
    LEARNED,
    MissionSet,
    PLAN,
    QMIX,
    RULES,
    TrainedPolicies,
)
from uav_collect.training.config import load_preset
from uav_collect.uav.policy import policy_for, specialist_name, STRONG


@dataclass
class Requests:
    """The jobs that studies have asked for so far."""

    scale: ScaleConfig
    jobs: dict[str, Job] = field(default_factory=dict)  # by digest
    _asked: set[str] = field(default_factory=set)  # since they were last taken
    _texts: dict[Scenario, str] = field(default_factory=dict)  # as YAML, slowly written
    _trainings: dict[object, TrainedPolicies] = field(default_factory=dict)

    def add(self, job: Job) -> str:
        """Ask for a job; returns its digest."""
        digest = digest_of(job)
        self.jobs[digest] = job
        self._asked.add(digest)
        return digest

    def trained_by(self, *decisions: int) -> str:
        """The settings of trainings, for a caption; a study names what it sets besides.

        Args:
            decisions: how many each takes.
        """
        trainings = self.scale.trainings
        text = ', '.join(f'{key} = {value}' for key, value in trainings.set.items())
        least, most = min(decisions), max(decisions)
        count = f'{least:,}' if least == most else f'{least:,} to {most:,}'
        return f'preset {trainings.preset}{f" with {text}" if text else ""}, {count} decisions'

    def take_new(self) -> frozenset[str]:
        """The jobs asked for since the last call."""
        taken, self._asked = frozenset(self._asked), set()
        return taken

    def train(
        self,
        label: str,
        scenario: Scenario,
        decisions: int,
        n_seeds: int,
        **settings: object,
    ) -> TrainedPolicies:
        """Ask for trainings.

        Args:
            label: of the algorithm.
            settings: that replace the preset's, by dotted path with __ for the dot.
        """
        known = (label, self._text(scenario), decisions, n_seeds, tuple(settings.items()))
        if known not in self._trainings:
            trainings = self.scale.trainings
            values = {name.replace('__', '.'): value for name, value in settings.items()}
            config = load_preset(trainings.preset, trainings.set | values)
            algorithm = _algorithm(label, scenario)
            first = training_job(scenario, config, algorithm, 0, decisions)
            self._trainings[known] = TrainedPolicies(
                label=label,
                algorithm=algorithm,
                digests=tuple(self.add(replace(first, seed=seed)) for seed in range(n_seeds)),
            )
        self._asked.update(self._trainings[known].digests)
        return self._trainings[known]

    def fly(
        self, trained: TrainedPolicies, scenario: Scenario, bandwidth: str = 'exact'
    ) -> MissionSet:
        """Ask for test missions of each policy that trainings gave."""
        rows = [
            self._tested(trained.algorithm, (training,), scenario, bandwidth)
            for training in trained.digests
        ]
        return MissionSet(digests=tuple(rows), trainings=trained.digests)

    def fly_rule(self, label: str, scenario: Scenario, bandwidth: str = 'exact') -> MissionSet:
        """Ask for test missions of a rule."""
        return MissionSet(digests=(self._tested(RULES[label], (), scenario, bandwidth),))

    def fly_untrained(self, label: str, scenario: Scenario) -> MissionSet:
        """Ask for test missions of a rule, or of the policy that is shipped for a scenario.

        Raises:
            PolicyMismatchError: none is shipped for it.
        """
        if label != STRONG:
            return self.fly_rule(label, scenario)
        # Whatever a study changes, the policy that is shipped for the scenario flies.
        shipped = policy_for(specialist_name(scenario), scenario)
        policy = f'{shipped.name} {shipped.version}'
        return MissionSet(digests=(self._tested(policy, (), scenario, 'exact'),))

    def plan(self, scenario: Scenario, bandwidth: str = 'exact') -> MissionSet:
        """Ask for plans of the test missions."""
        digests = [
            self.add(
                PlansJob(
                    scenario=self._text(scenario),
                    bandwidth=bandwidth,
                    first_seed=seeds[0],
                    n_missions=len(seeds),
                    n_rounds=self.scale.tests.plan_rounds,
                )
            )
            for seeds in self._parts()
        ]
        return MissionSet(digests=(tuple(digests),), is_planned=True)

    def references(self, scenario: Scenario, bandwidth: str = 'exact') -> dict[str, MissionSet]:
        """Ask for what learned policies stand beside, by label."""
        ruled = {label: self.fly_rule(label, scenario, bandwidth) for label in RULES}
        return {**ruled, PLAN: self.plan(scenario, bandwidth)}

    def log_mission(self, trained: TrainedPolicies, scenario: Scenario, mission_seed: int) -> str:
        """Ask for the log of one mission by the policy that is the best in validation."""
        return self.add(
            _flights(
                trained.algorithm,
                trained.digests,
                self._text(scenario),
                'exact',
                range(mission_seed, mission_seed + 1), keeps_logs=True,
            )
        )  # fmt: skip

    def _tested(
        self, policy: str, trainings: Sequence[str], scenario: Scenario, bandwidth: str
    ) -> tuple[str, ...]:
        return tuple(
            self.add(_flights(policy, trainings, self._text(scenario), bandwidth, seeds))
            for seeds in self._parts()
        )

    def _text(self, scenario: Scenario) -> str:
        """The scenario as YAML."""
        if scenario not in self._texts:
            self._texts[scenario] = scenario.to_yaml()
        return self._texts[scenario]

    def _parts(self) -> list[range]:
        """The seeds of the test missions, job by job."""
        tests = self.scale.tests
        seeds = range(tests.first_seed, tests.first_seed + tests.missions)
        size = tests.missions_per_job
        return [seeds[start : start + size] for start in range(0, len(seeds), size)]


def _algorithm(label: str, scenario: Scenario) -> str:
    """What is trained: QMIX of a single UAV, which waits for nobody, is AQMIX."""
    return LEARNED[AQMIX if label == QMIX and scenario.n_uavs == 1 else label]


def _flights(
    policy: str,
    trainings: Sequence[str],
    scenario: str,
    bandwidth: str,
    seeds: range,
    *,
    keeps_logs: bool = False,
) -> FlightsJob:
    return FlightsJob(
        scenario=scenario,
        policy=policy,
        trainings=tuple(trainings),
        bandwidth=bandwidth,
        first_seed=seeds[0],
        n_missions=len(seeds),
        keeps_logs=keeps_logs,
    )
