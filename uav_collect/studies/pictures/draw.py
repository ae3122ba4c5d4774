"""Draws a study from what was found for it, and from nothing else."""

from uav_collect.studies.findings import Findings
from uav_collect.studies.pictures import curves, lines, missions, runs
from uav_collect.studies.pictures.drawing import Drawing
from uav_collect.studies.study import (
    CurvesStudy,
    LinesStudy,
    RunsStudy,
    Study,
    TopologyStudy,
    TrajectoriesStudy,
)


def draw(study: Study, findings: Findings) -> Drawing:
    """Draw a study.

    Raises:
        StoreError: a job of it is not done.
    """
    match study:
        case LinesStudy():
            return lines.draw(study, findings)
        case CurvesStudy():
            return curves.draw(study, findings)
        case TopologyStudy():
            return missions.draw_topology(study)
        case TrajectoriesStudy():
            return missions.draw_trajectories(study, findings)
        case RunsStudy():
            return runs.draw(study, findings)
