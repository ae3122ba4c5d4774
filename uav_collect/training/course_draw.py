"""Draws courses: each a scenario that follows from a distribution, a run's seed and a number."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
import math

import numpy as np
from uav_collect.errors import ConfigError
from uav_collect.physics.energy import propulsion_power_w
from uav_collect.scenario.area import mean_data_cells, open_cells
from uav_collect.scenario.model import (
    AreaConfig,
    DrawnSensors,
    FaultConfig,
    FleetConfig,
    Place,
    Point,
    Polygon,
    PropulsionConfig,
    Scenario,
    UavConfig,
)
from uav_collect.scenario.site import build_site
from uav_collect.training.courses import (
    CourseDistribution,
    JITTER,
    LEAST_DATA,
    Span,
    TaughtCourses,
    TaughtFleet,
)
from uav_collect.uav.actions import check_can_start
from uav_collect.uav.briefing import briefing_of, mean_hover_s

_COURSE_KEY = 2  # of the run's seed: which courses are drawn
_MOST_TRIES = 100
_DETOURS = 1.3  # crossings of a plan for each cell of the area
_MOST_NO_FLY_ASPECT = 3.0


def draw_course(distribution: CourseDistribution, seed: int, index: int) -> Scenario:
    """A course that a fleet can start in.

    Args:
        seed: of the run, 0..2^62.
        index: number of the course, from 0.

    Raises:
        ConfigError: what is drawn can hardly ever be flown.
    """
    refusal = ''
    for attempt in range(_MOST_TRIES):
        bits = np.random.Philox(key=[seed, _COURSE_KEY], counter=[0, 0, index, attempt])
        draw = _Draw(rng=np.random.Generator(bits), distribution=distribution)
        try:
            course = replace(draw.course(), name=f'{distribution.name}-{index}')
            check_can_start(course, briefing_of(build_site(course)))
        except ConfigError as error:
            refusal = str(error)
        else:
            return course
    raise ConfigError(
        f'courses {distribution.name}: number {index} cannot be flown, drawn {_MOST_TRIES} times:'
        f' {refusal}'
    )


@dataclass(frozen=True, kw_only=True)
class _Draw:
    """One course as it is drawn; each method draws a part of it, in this order."""

    rng: np.random.Generator
    distribution: CourseDistribution

    def course(self) -> Scenario:
        base, taught = self.distribution.base, self.distribution.taught
        fleets = self.distribution.taught_fleets
        if taught is not None and fleets and self._chance(taught.share):
            return self._taught(taught, fleets)
        area, sensors = self._area(), self._sensors()
        course = replace(base, area=area, sensors=sensors, faults=None)
        course = self._with_demand(course)
        course = self._with_radio(course)
        course = self._with_fleet(course)
        return self._with_faults(course)

    def _taught(self, courses: TaughtCourses, fleets: Sequence[TaughtFleet]) -> Scenario:
        """A course like one that a teacher learned on."""
        base = self.distribution.base
        fleet = fleets[int(self.rng.integers(len(fleets)))]
        is_own_field = self._chance(courses.own_field_share)
        area = self._area(base.area.cell_size_m if is_own_field else None)
        if side := fleet.cells_per_side:
            area = replace(area, rows=side, columns=side, no_fly=())
        uavs = tuple(replace(base.uavs[0], speed_mps=speed) for speed in fleet.speeds_mps)
        course = replace(base, area=area, fleet=FleetConfig(uavs=uavs), faults=None)
        if is_own_field:
            share, sensors = self._by_log(courses.cell_share), base.sensors
            if isinstance(sensors, DrawnSensors):
                sensors = replace(sensors, seed=int(self.rng.integers(2**62)))
            demand = replace(base.demand, cell_share=share)
            course = replace(course, sensors=sensors, demand=demand)
        else:
            course = self._with_demand(replace(course, sensors=self._sensors()))
        if not self._chance(courses.own_budget_share):
            course = _with_budgets(course, self._budget_factor())
        return self._with_faults(self._with_radio(course))

    def _chance(self, share: float) -> bool:
        return bool(self.rng.random() < share)

    def _even(self, span: Span) -> float:
        return float(self.rng.uniform(*span))

    def _by_log(self, span: Span) -> float:
        return math.exp(self.rng.uniform(math.log(span[0]), math.log(span[1])))

    def _whole_by_log(self, span: tuple[int, int]) -> int:
        return min(span[1], int(self._by_log((span[0], span[1] + 1))))

    def _area(self, own_size_m: float | None = None) -> AreaConfig:
        """An area with cells of its own size, or of a drawn one."""
        courses = self.distribution.area
        n_rows = self._whole_by_log(courses.cells_per_side)
        n_columns = self._whole_by_log(courses.cells_per_side)
        if self._chance(courses.square_share):
            n_columns = n_rows
        size_m = round(self._by_log(courses.cell_size_m), 1)
        area = AreaConfig(
            rows=n_rows,
            columns=n_columns,
            cell_size_m=own_size_m or size_m,
            altitude_m=self.distribution.base.area.altitude_m,
        )
        if not self._chance(courses.no_fly_share):
            return area
        return replace(area, no_fly=(self._zone(area),))

    def _zone(self, area: AreaConfig) -> Polygon:
        """A rectangle of cells that leaves a row and a column free: all others stay in reach."""
        n_cells = self._even(self.distribution.area.no_fly_cells) * area.n_cells
        aspect = self._by_log((1.0 / _MOST_NO_FLY_ASPECT, _MOST_NO_FLY_ASPECT))
        high = min(max(1, round(math.sqrt(n_cells * aspect))), area.n_rows - 1)
        wide = min(max(1, round(n_cells / high)), area.n_columns - 1)
        row = int(self.rng.integers(area.n_rows - high + 1))
        column = int(self.rng.integers(area.n_columns - wide + 1))
        size_m = area.cell_size_m
        west_m, south_m = column * size_m, row * size_m
        east_m, north_m = west_m + wide * size_m, south_m + high * size_m
        return (west_m, south_m), (east_m, south_m), (east_m, north_m), (west_m, north_m)

    def _sensors(self) -> DrawnSensors:
        courses = self.distribution.sensors
        return DrawnSensors(
            kind='drawn',
            seed=int(self.rng.integers(2**62)),
            dense_cell_share=self._even(courses.dense_cell_share),
            dense_mean=self._by_log(courses.dense_mean),
            sparse_mean=self._by_log(courses.sparse_mean),
        )

    def _with_demand(self, course: Scenario) -> Scenario:
        courses = self.distribution.demand
        is_all, share = self._chance(courses.all_share), self._by_log(courses.cell_share)
        most_mbit = self._by_log(courses.most_mbit)
        is_empty_known = self._chance(courses.known_empty_share)
        demand = replace(
            course.demand,
            cell_share='all' if is_all else share,
            data_mbit=(LEAST_DATA * most_mbit, most_mbit),
            known_empty='sensors' if is_empty_known else None,
        )
        return replace(course, demand=demand)

    def _with_radio(self, course: Scenario) -> Scenario:
        courses = self.distribution.radio
        kind = self.rng.random()
        range_m = self._by_log(courses.contact_range_cells) * course.area.cell_size_m
        if kind < courses.none_share:
            range_m = 0.0
        elif kind < courses.none_share + courses.unlimited_share:
            range_m = math.inf
        radio = replace(course.radio, contact_range_m=range_m)
        is_rough = self._chance(courses.rough_share)
        loss_share, delay_s = self._even(courses.loss_share), self._even(courses.delay_s)
        if is_rough and range_m > 0.0:
            radio = replace(radio, loss_share=loss_share, delay_s=(delay_s, JITTER * delay_s))
        return replace(course, radio=radio)

    def _with_fleet(self, course: Scenario) -> Scenario:
        courses = self.distribution.fleet
        low, high = courses.n_uavs
        n_uavs = int(self.rng.integers(low, high + 1))
        speeds_mps = [round(self._by_log(courses.speed_mps), 1) for _ in range(n_uavs)]
        if self._chance(courses.alike_share):
            speeds_mps = speeds_mps[:1] * n_uavs
        homes = [self._home(course.area) for _ in range(n_uavs)]
        if not self._chance(courses.apart_share):
            homes = homes[:1] * n_uavs
        factor = self._budget_factor()
        like = course.uavs[0]
        uavs = [
            replace(like, speed_mps=speed_mps, start=home, home=home, battery=None)
            for speed_mps, home in zip(speeds_mps, homes, strict=True)
        ]
        return _with_budgets(replace(course, fleet=FleetConfig(uavs=tuple(uavs))), factor)

    def _budget_factor(self) -> float:
        """What UAVs may spend, in what their parts of all cells cost."""
        courses = self.distribution.fleet
        is_tight = self._chance(courses.tight_share)
        return self._even(courses.tight if is_tight else courses.ample)

    def _home(self, area: AreaConfig) -> Place:
        """The centre of an open cell, where UAVs start and land."""
        courses, kind = self.distribution.fleet, self.rng.random()
        row, column = np.divmod(np.flatnonzero(open_cells(area)), area.n_columns)
        at_side = np.isin(row, (0, area.n_rows - 1)).astype(np.int64)
        at_side += np.isin(column, (0, area.n_columns - 1))
        wanted = 2 if kind < courses.corner_share else 1
        if kind >= courses.corner_share + courses.edge_share:
            wanted = 0
        places = np.flatnonzero(at_side == wanted)
        if not len(places):  # closed, or an area of one row
            places = np.arange(len(row))
        place = places[self.rng.integers(len(places))]
        return Place(position_m=_centre_m(area, int(row[place]), int(column[place])))

    def _with_faults(self, course: Scenario) -> Scenario:
        courses = self.distribution.faults
        kind = courses.kinds[int(self.rng.integers(len(courses.kinds)))]
        if not self._chance(courses.share) or course.n_uavs < 2:
            return course
        planned_s = _planned_s(course)
        at_s = courses.at_share[0] * planned_s, courses.at_share[1] * planned_s
        fault = FaultConfig(uav='any', kind=kind, at_s=at_s, share=courses.mission_share)
        return replace(course, faults=(fault,))


def _centre_m(area: AreaConfig, row: int, column: int) -> Point:
    return (column + 0.5) * area.cell_size_m, (row + 0.5) * area.cell_size_m


def _planned_s(course: Scenario) -> float:
    """About how long the fleet flies to visit all cells [s]."""
    way_m = _DETOURS * float(open_cells(course.area).sum()) * course.area.cell_size_m
    return way_m / math.fsum(uav.speed_mps for uav in course.uavs)


def _with_budgets(course: Scenario, factor: float) -> Scenario:
    """Each UAV may spend so many times what its part of all cells costs."""
    return replace(course, fleet=FleetConfig(uavs=tuple(
        replace(uav, energy_budget_kj=round(factor * _needs_j(course, uav) / 1e3, 2))
        for uav in course.uavs
    )))  # fmt: skip


def _needs_j(course: Scenario, uav: UavConfig) -> float:
    """About what a UAV spends on its part of all cells, their data, and the way there and back."""
    area = course.area
    away_s = (area.width_m + area.height_m) / uav.speed_mps
    flying_s = _planned_s(course) + away_s
    n_sensors = build_site(course).n_sensors / max(1, int(open_cells(area).sum()))
    hover_s = mean_hover_s(course, n_sensors) * mean_data_cells(course) / course.n_uavs
    power_w, hover_w = _power_w(uav.propulsion, uav.speed_mps), _power_w(uav.propulsion, 0.0)
    return power_w * flying_s + hover_w * hover_s + uav.energy_margin_j


def _power_w(rotor: PropulsionConfig, speed_mps: float) -> float:
    return propulsion_power_w(
        speed_mps,
        rotor.blade_profile_power_w,
        rotor.induced_power_w,
        rotor.tip_speed_mps,
        rotor.induced_speed_mps,
        rotor.parasite_coefficient,
    )
