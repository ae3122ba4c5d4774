"""Where claims take their numbers from: studies by name, lines by label."""

from collections.abc import Mapping
from dataclasses import dataclass

from uav_collect.studies.claims.judging import Samples
from uav_collect.studies.findings import Findings
from uav_collect.studies.study import (
    CurvesPanel,
    CurvesStudy,
    LinesStudy,
    Measure,
    Study,
    Tested,
    Trained,
    TrajectoriesStudy,
)


@dataclass(frozen=True)
class Sources:
    """The studies that were run, and what was found."""

    studies: Mapping[str, Study]
    findings: Findings

    def lines(self, name: str) -> LinesStudy:
        """A study of tests."""
        study = self.studies[name]
        if not isinstance(study, LinesStudy):
            raise TypeError(f'{name} is no study of tests')
        return study

    def panels(self, name: str) -> tuple[CurvesPanel, ...]:
        """The panels of a study of trainings."""
        study = self.studies[name]
        if not isinstance(study, CurvesStudy):
            raise TypeError(f'{name} is no study of trainings')
        return study.panels

    def trajectories(self, name: str) -> TrajectoriesStudy:
        """A study of single missions."""
        study = self.studies[name]
        if not isinstance(study, TrajectoriesStudy):
            raise TypeError(f'{name} is no study of single missions')
        return study

    def tested(self, study: LinesStudy, label: str, index: int, measure: Measure) -> Samples:
        """A measure by mission, of a line at the value of that index."""
        return self.missions(study.line(label).tests[index], measure)

    def missions(self, tested: Tested, measure: Measure) -> Samples:
        """A measure by mission."""
        column = self.findings.column(tested, measure)
        if column is None:
            raise ValueError(f'plans have no {measure.title}')
        return Samples(value=column.value, noun='mission')

    def ends(self, trained: Trained, key: str, n_seeds: int | None = None) -> Samples:
        """What trainings achieved in their last fifth, by seed."""
        return Samples(value=self.findings.ends(trained, key)[:n_seeds], noun='seed')
