"""Courses: the scenarios that a policy learns in which is to fly anywhere, drawn one by one.

config/training/courses/anywhere.yaml says what each key means. A distribution that was read stands
alone: the scenario it is based on is part of it.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
import hashlib
from itertools import product
import math
from pathlib import Path
from typing import Annotated, Literal

from uav_collect.config import layers, yaml_text
from uav_collect.config.installed import shared_folders
from uav_collect.config.layers import Document
from uav_collect.config.rules import (
    Entries,
    name,
    number,
    number_span,
    Section,
    text,
    validated,
    whole,
    whole_span,
)
from uav_collect.errors import ConfigError
from uav_collect.limits import MAX_CELLS_PER_SIDE, MAX_DATA_MBIT, MAX_UAVS
from uav_collect.scenario.model import Scenario
from uav_collect.training.panel import load_panel, Panel
from uav_collect.training.resolved import resolved_scenario, with_value
from uav_collect.uav.learned_on import LearnedWithin
from uav_collect.uav.operating_domain import MAX_DOMAINS, OperatingDomain

JITTER = 0.5  # of messages that are late, as a share of the mean delay
LEAST_DATA = 0.1  # of a sensor that has any, as a share of the most

Span = tuple[float, float]
_Share = Annotated[float, number(0, 1)]


class AreaCourses(Section):
    """Areas: how large, and what of them is closed."""

    cells_per_side: Annotated[tuple[int, int], whole_span(2, MAX_CELLS_PER_SIDE)]
    square_share: _Share
    cell_size_m: Annotated[Span, number_span(1, 10_000, 'm')]
    no_fly_share: _Share
    no_fly_cells: Annotated[Span, number_span(0, 0.5)]


class SensorCourses(Section):
    """Sensors, drawn as in the paper."""

    dense_cell_share: Annotated[Span, number_span(0, 1)]
    dense_mean: Annotated[Span, number_span(0.01, 100, 'sensors per cell')]
    sparse_mean: Annotated[Span, number_span(0.01, 100, 'sensors per cell')]


class DemandCourses(Section):
    """How much data waits where."""

    cell_share: Annotated[Span, number_span(1e-3, 1)]
    all_share: _Share
    known_empty_share: _Share
    most_mbit: Annotated[Span, number_span(1e-3, MAX_DATA_MBIT, 'Mbit')]


class FleetCourses(Section):
    """Fleets: how many, how fast, from where, and with how much energy."""

    n_uavs: Annotated[tuple[int, int], whole_span(1, MAX_UAVS)]
    speed_mps: Annotated[Span, number_span(0.1, 100, 'm/s')]
    alike_share: _Share
    corner_share: _Share
    edge_share: _Share
    apart_share: _Share
    ample: Annotated[Span, number_span(0.1, 1000)]
    tight: Annotated[Span, number_span(0.1, 1000)]
    tight_share: _Share


class RadioCourses(Section):
    """How UAVs hear each other."""

    none_share: _Share
    unlimited_share: _Share
    contact_range_cells: Annotated[Span, number_span(0.1, 1000, 'cells')]
    rough_share: _Share
    loss_share: Annotated[Span, number_span(0, 0.99)]
    delay_s: Annotated[Span, number_span(0.01, 1000, 's')]


class FaultCourses(Section):
    """What befalls a UAV of a fleet."""

    share: _Share
    kinds: Annotated[tuple[Literal['gone', 'silent', 'slow'], ...], Entries(1, 3)]
    at_share: Annotated[Span, number_span(0, 10)]
    mission_share: _Share


class TaughtFleet(Section):
    """A fleet for which there is a teacher, and its area; the rest is the base's."""

    cells_per_side: Annotated[int | None, whole(2, MAX_CELLS_PER_SIDE)] = None  # absent: any area
    speeds_mps: Annotated[
        tuple[Annotated[float, number(0.1, 100, 'm/s')], ...], Entries(1, MAX_UAVS)
    ]


class TaughtCourses(Section):
    """Courses like those that teachers learned on, and such that differ by radio and faults."""

    share: _Share
    fleets: Annotated[tuple[TaughtFleet, ...], Entries(1, 64)]
    own_budget_share: _Share  # the others have budgets as all fleets
    own_field_share: _Share  # the others have cells, sensors and demand as all fields
    cell_share: Annotated[Span, number_span(1e-3, 1)]


class CourseDistribution(Section):
    """What courses are drawn from."""

    name: Annotated[str, name()]
    base: Scenario
    panel: Annotated[str, text(4096)]
    area: AreaCourses
    sensors: SensorCourses
    demand: DemandCourses
    fleet: FleetCourses
    radio: RadioCourses
    faults: FaultCourses
    taught: TaughtCourses | None = None  # absent: there are none
    # Where policies that learn here decide by themselves; absent: everywhere.
    domains: Annotated[tuple[OperatingDomain, ...] | None, Entries(1, MAX_DOMAINS)] = None

    @property
    def learned_within(self) -> LearnedWithin:
        """What a policy gets used to that learns on these courses."""
        area, sensors, demand, radio = self.area, self.sensors, self.demand, self.radio
        is_rough, latest_s = radio.rough_share > 0.0, (1.0 + JITTER) * radio.delay_s[1]
        nearest, farthest = radio.contact_range_cells
        return LearnedWithin(
            cells_per_side=area.cells_per_side,
            cell_size_m=area.cell_size_m,
            closed_share=(0.0, area.no_fly_cells[1] if area.no_fly_share > 0.0 else 0.0),
            n_uavs=self.fleet.n_uavs,
            speed_mps=self.fleet.speed_mps,
            contact_range_m=(
                0.0 if radio.none_share > 0.0 else nearest * area.cell_size_m[0],
                math.inf if radio.unlimited_share > 0.0 else farthest * area.cell_size_m[1],
            ),
            loss_share=(0.0, radio.loss_share[1] if is_rough else 0.0),
            delay_s=(0.0, latest_s if is_rough else 0.0),
            sensors_per_cell=_sensors_per_cell(sensors),
            cell_share=(demand.cell_share[0], 1.0 if demand.all_share else demand.cell_share[1]),
            data_mbit=(LEAST_DATA * demand.most_mbit[0], demand.most_mbit[1]),
        )

    @property
    def taught_fleets(self) -> tuple[TaughtFleet, ...]:
        """Those of taught courses that lie within what areas and fleets are drawn from."""
        sides, n_uavs = self.area.cells_per_side, self.fleet.n_uavs
        fleets = () if self.taught is None else self.taught.fleets
        return tuple(
            fleet
            for fleet in fleets
            if sides[0] <= (fleet.cells_per_side or sides[0]) <= sides[1]
            and n_uavs[0] <= len(fleet.speeds_mps) <= n_uavs[1]
        )

    @property
    def fingerprint(self) -> str:
        """16 hex digits that change with anything that courses are drawn from."""
        values = {key: it for key, it in self.as_mapping().items() if key != 'panel'}
        return hashlib.sha256(yaml_text.dump(values).encode()).hexdigest()[:16]

    def to_yaml(self) -> str:
        """The distribution as a file that stands alone."""
        return yaml_text.dump(self.as_mapping())


@dataclass(frozen=True, kw_only=True)
class Courses:
    """What a policy learns on that is to fly anywhere, and what it is validated in."""

    distribution: CourseDistribution
    panel: Panel

    @property
    def fingerprints(self) -> str:
        """Those of both, which change with anything that training depends on."""
        return f'{self.distribution.fingerprint} {self.panel.fingerprint}'


def load_courses(
    name_or_path: str | Path, overrides: Mapping[str, object] | None = None
) -> Courses:
    """Read a distribution and the panel that it names.

    Args:
        name_or_path: 'anywhere', or 'my/courses.yaml'.
        overrides: values by dotted path ('fleet.n_uavs'), which count more than the file's.

    Raises:
        ConfigError: one line per problem: file and line, key, value, what is allowed.
    """
    document = _distribution_document(name_or_path, overrides)
    distribution = _validated(document)
    panel = distribution.panel
    if panel.endswith(('.yaml', '.yml')):
        return Courses(
            distribution=distribution,
            panel=load_panel(document.source(('panel',)).folder / panel),
        )
    return Courses(distribution=distribution, panel=load_panel(panel))


def _sensors_per_cell(courses: SensorCourses) -> Span:
    """The least and the most sensors of a cell, on the average of an area."""
    means = [
        dense * in_dense + (1.0 - dense) * in_sparse
        for dense, in_dense, in_sparse in product(
            courses.dense_cell_share, courses.dense_mean, courses.sparse_mean
        )
    ]
    return min(means), max(means)


def load_distribution(
    name_or_path: str | Path, overrides: Mapping[str, object] | None = None
) -> CourseDistribution:
    """Read a distribution by its name among the shipped ones, or by the path of a YAML file.

    Raises:
        ConfigError: as `load_courses`.
    """
    return _validated(_distribution_document(name_or_path, overrides))


def _validated(document: Document) -> CourseDistribution:
    distribution = validated(CourseDistribution, document)
    problems = [
        document.problem(('domains', number, 'relative_speeds'), why)
        for number, domain in enumerate(distribution.domains or ())
        if (why := domain.contradiction)
    ]
    if problems:
        raise ConfigError(*problems)
    return distribution


def _distribution_document(
    name_or_path: str | Path, overrides: Mapping[str, object] | None
) -> Document:
    folders = shared_folders('training/courses')
    document = layers.load(name_or_path, folders, field='courses', overrides=overrides)
    if not isinstance(document.at(('base',)), str):
        return document
    base = resolved_scenario(document, ('base',)).as_mapping()
    return replace(document, values=with_value(document.values, ('base',), base))
