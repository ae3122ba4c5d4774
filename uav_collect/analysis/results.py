"""What users of Python get of their flights: a mission with its log and metrics, or many."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from io import BytesIO, StringIO
from pathlib import Path

import numpy as np
from rich.console import RenderableType
from uav_collect import files
from uav_collect.analysis.console import plain_console
from uav_collect.analysis.metrics import mission_metrics, MissionMetrics
from uav_collect.analysis.readings import is_left, mission_readings, Reading
from uav_collect.analysis.statistics import Estimate, MEASURES, paired_differences
from uav_collect.analysis.tables import evaluation_table, mission_tables
from uav_collect.kernels.arrays import Floats
from uav_collect.recording.mission_log import MissionLog
from uav_collect.scenario.site import Site
from uav_collect.world.sensor_field import demand_of

_COLUMNS = 99  # of a table as text


@dataclass(frozen=True, kw_only=True, eq=False)
class FlownMission:
    """A mission that was flown, and where; printed, it is what it achieved, UAV by UAV."""

    log: MissionLog
    site: Site
    demand_bit: Floats  # (S,) at the start
    n_radio_messages: int | None = None  # None: a log does not tell
    is_whole: bool = True  # its end was recorded
    given_up: str | None = None  # why its world did that, if it did

    @cached_property
    def metrics(self) -> MissionMetrics:
        """What the mission achieved, and each UAV's part."""
        return mission_metrics(self.log)

    @cached_property
    def readings(self) -> tuple[Reading, ...]:
        """Which sensor was read when, by whom and at which rate, in the order of the hovers."""
        return mission_readings(self.log, self.site, self.demand_bit)

    @cached_property
    def unread(self) -> tuple[str, ...]:
        """The ids of the sensors whose data were left behind; none if the log lacks events."""
        left = np.flatnonzero(is_left(self.log, self.site, self.demand_bit)).tolist()
        return tuple(self.site.sensor_ids[sensor] for sensor in left)

    @property
    def lack(self) -> str | None:
        """What the record of it lacks, for people; None where it has the mission's end."""
        if self.is_whole:
            return None
        if self.given_up is not None:
            return f'its world gave the mission up: {self.given_up or "it does not say why"}'
        return 'the mission was given up, not all of it was recorded, or some of it is damaged'

    def draw(self, file: str | Path) -> None:
        """Draw who flew where into a PNG file; the same mission gives the same bytes.

        Raises:
            OSError: the file cannot be written.
        """
        from uav_collect.analysis.trajectories import trajectories

        drawn = BytesIO()
        trajectories(self.log, self.site, self.demand_bit, drawn)
        files.write_result(Path(file), drawn.getvalue())

    def __str__(self) -> str:
        n_messages, left = self.n_radio_messages, self.unread
        return _text(mission_tables(self.log.header, self.metrics, n_messages, left=left))


@dataclass(frozen=True, kw_only=True, eq=False)
class Evaluation:
    """What policies achieve in the same missions; printed, it is a table of means."""

    title: str
    metrics: Mapping[str, Sequence[MissionMetrics]]  # by policy as given, in the seeds' order
    estimates: Mapping[str, Mapping[str, Estimate]]  # by policy and measure, such as completion_s
    seed: int  # of the first mission; keys the bootstrap

    def difference(self, policy: str, other: str) -> Mapping[str, Estimate]:
        """By how much a policy is above another one, mission by mission; by measure.

        Raises:
            KeyError: a policy was not evaluated.
        """
        rows = paired_differences(self.metrics[policy], self.metrics[other], self.seed)
        return by_measure(rows)

    def __str__(self) -> str:
        rows = {policy: [*row.values()] for policy, row in self.estimates.items()}
        return f'{self.title}\n{_text(evaluation_table(self.metrics, rows, _COLUMNS))}'


def flown_mission(log: MissionLog, site: Site) -> FlownMission:
    """A mission of which the log is left; its demand is drawn again."""
    demand_bit = demand_of(site, log.header.mission_seed)
    return FlownMission(log=log, site=site, demand_bit=demand_bit)


def by_measure(row: Sequence[Estimate]) -> dict[str, Estimate]:
    """Estimates of all measures by the key of each."""
    return {measure.key: estimate for measure, estimate in zip(MEASURES, row, strict=True)}


def _text(table: RenderableType) -> str:
    console = plain_console(file=StringIO(), width=_COLUMNS)
    with console.capture() as shown:
        console.print(table)
    return '\n'.join(line.rstrip() for line in shown.get().splitlines()).rstrip()
