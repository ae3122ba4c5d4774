"""Draws a study from what was found for it, and from nothing else."""

from uav_collect.studies import curve_figures, line_figures, mission_figures
from uav_collect.studies.drawing import Drawn
from uav_collect.studies.findings import Findings
from uav_collect.studies.records import (
    CurvesStudy,
    LinesStudy,
    Study,
    TopologyStudy,
    TrajectoriesStudy,
)


def draw(study: Study, findings: Findings) -> Drawn:
    """Draw a study.

    Raises:
        StoreError: a job of it is not done.
    """
    match study:
        case LinesStudy():
            return line_figures.draw(study, findings)
        case CurvesStudy():
            return curve_figures.draw(study, findings)
        case TopologyStudy():
            return mission_figures.draw_topology(study)
        case TrajectoriesStudy():
            return mission_figures.draw_trajectories(study, findings)
