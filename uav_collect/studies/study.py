"""What studies are made of, as those see it who draw and judge: jobs that belong together."""

from collections.abc import Mapping
from dataclasses import dataclass

from uav_collect.scenario.model import Scenario
from uav_collect.uav.policy import STRONG

AQMIX, QMIX, AIQL, HERT, SWEEP, PLAN = 'AQMIX', 'QMIX', 'AIQL', 'HERT', 'sweep', 'plan'
LEARNED = {AQMIX: 'aqmix', QMIX: 'qmix', AIQL: 'aiql'}  # the paper's order
RULES = {HERT: 'hert', SWEEP: 'sweep'}
UNTRAINED = (STRONG, *RULES)  # what flies without a training of its own


@dataclass(frozen=True, kw_only=True)
class TrainedPolicies:
    """One algorithm's trainings on one scenario, which differ in their seed alone."""

    label: str
    algorithm: str
    digests: tuple[str, ...]  # seed 0, 1, ...


@dataclass(frozen=True, kw_only=True)
class MissionSet:
    """Missions on one scenario: of a rule, of each policy that was trained, or planned."""

    # Of jobs: a row for each training, or one; in a row in the order of the mission seeds.
    digests: tuple[tuple[str, ...], ...]
    trainings: tuple[str, ...] = ()  # digests; none where nothing was trained
    is_planned: bool = False


@dataclass(frozen=True, kw_only=True)
class PanelMeasure:
    """What the vertical axis of a panel shows."""

    key: str  # a column of the missions; the unit is its last word
    title: str
    unit: str
    plan_key: str = ''  # the column of the plans that goes with it; '' where none does
    scale: float = 1.0  # from the column to what is shown
    factors: tuple[str, ...] = ()  # the columns whose product it is; none: the one of the key


EFFICIENCY = PanelMeasure(
    key='efficiency_kbit_per_j',
    title='energy efficiency',
    unit='kbit/J',
    plan_key='thriftiest_efficiency_kbit_per_j',
)
COMPLETION = PanelMeasure(
    key='completion_s', title='completion time', unit='s', plan_key='shortest_completion_s'
)
COLLECTED = PanelMeasure(key='collected_share', title='data collected', unit='%', scale=100.0)
FINISHED = PanelMeasure(
    key='complete_safe_share', title='complete missions, all UAVs home',
    unit='%', scale=100.0, factors=('is_complete', 'is_safe'),
)  # fmt: skip
ENERGY = PanelMeasure(
    key='energy_kj', title='energy, all UAVs', unit='kJ', plan_key='thriftiest_energy_kj'
)
COLLECTING = PanelMeasure(key='collecting_s', title='time spent collecting, all UAVs', unit='s')
REWARD = PanelMeasure(key='training_reward', title='reward of a mission in training', unit='1')


@dataclass(frozen=True, kw_only=True)
class Line:
    """The tests of one policy, one for each value of what is varied."""

    label: str
    policy: str  # one of the labels above
    tests: tuple[MissionSet, ...]  # one for each value
    is_thin: bool = False  # drawn as the lesser one of two of a policy


@dataclass(frozen=True, kw_only=True)
class LinesStudy:
    """Tests over what is varied: a figure with a panel for each measure."""

    name: str
    figure: int | None  # of the paper; None: it has none
    title: str
    about: str  # what is trained for it, what only tested
    over: str  # what is varied, with its unit
    column: str  # the same in the CSV; the unit is its last word
    values: tuple[float, ...]
    measures: tuple[PanelMeasure, ...]
    lines: tuple[Line, ...]
    names: tuple[str, ...] = ()  # of the values; where they are, they stand side by side

    def line(self, label: str) -> Line:
        """The line with that label."""
        return next(line for line in self.lines if line.label == label)


@dataclass(frozen=True, kw_only=True)
class CurvesPanel:
    """The trainings on one scenario, drawn in one panel."""

    label: str
    key: str  # in the CSV
    curves: tuple[TrainedPolicies, ...]
    references: Mapping[str, MissionSet]  # by label

    def curve(self, label: str) -> TrainedPolicies:
        """The trainings with that label."""
        return next(curve for curve in self.curves if curve.label == label)


@dataclass(frozen=True, kw_only=True)
class CurvesStudy:
    """Learning curves: a figure with a column of panels for each scenario."""

    name: str
    figure: int
    title: str
    about: str
    panels: tuple[CurvesPanel, ...]


@dataclass(frozen=True, kw_only=True)
class TopologyStudy:
    """Where sensors are, and what a mission's demand may look like."""

    name: str
    figure: int
    title: str
    about: str
    scenario: Scenario
    mission_seed: int


@dataclass(frozen=True, kw_only=True)
class TrajectoriesStudy:
    """One mission as several policies fly it."""

    name: str
    figure: int
    title: str
    about: str
    scenario: Scenario
    mission_seed: int
    flown: Mapping[str, str]  # digest of the job that kept the log, by label
    tests: Mapping[str, MissionSet]  # many missions of the same policies, by label


@dataclass(frozen=True, kw_only=True)
class StudyTask:
    """A scenario on which each algorithm was trained and tested."""

    label: str
    key: str  # in files
    trained: Mapping[str, TrainedPolicies]  # by label
    tests: Mapping[str, MissionSet]  # by label; of what was trained, of rules, and the plans


@dataclass(frozen=True, kw_only=True)
class Suite:
    """Tasks over which algorithms are compared as a whole."""

    label: str
    key: str  # in files
    tasks: tuple[StudyTask, ...]


@dataclass(frozen=True, kw_only=True)
class RunsStudy:
    """Algorithms over many tasks, training by training."""

    name: str
    figure: None
    title: str
    about: str
    suites: tuple[Suite, ...]


Study = LinesStudy | CurvesStudy | TopologyStudy | TrajectoriesStudy | RunsStudy
