"""Courses small enough to be learned on in a test, and a panel of two conditions."""

from dataclasses import replace

from episodes import small
from tiny_world import tiny, uav
from uav_collect.training.config import TrainingConfig
from uav_collect.training.courses import Courses, load_distribution
from uav_collect.training.panel import Condition, Panel

FLEET = uav(5.0, energy_budget_kj=25.0), uav(10.0, energy_budget_kj=12.0)
_SIZES = {
    'name': 'small', 'area.cells_per_side': [3, 5], 'fleet.n_uavs': [1, 3],
    'sensors.sparse_mean': [1.0, 2.0], 'fleet.ample': [1.0, 1.5], 'faults.at_share': [0.0, 0.5],
}  # fmt: skip


def small_courses() -> Courses:
    """Areas of 3 to 5 cells a side, up to three UAVs, and two conditions of the tiny world."""
    conditions = tiny(*FLEET), tiny(*FLEET, uav(7.5, energy_budget_kj=20.0))
    panel = Panel(
        name='small',
        conditions=tuple(
            Condition(name=f'n{scenario.n_uavs}', scenario=replace(scenario, name='tiny'))
            for scenario in conditions
        ),
    )
    return Courses(distribution=load_distribution('anywhere', _SIZES), panel=panel)


def small_settings(preset: str = 'anywhere', **overrides: object) -> TrainingConfig:
    """Settings of a small training on courses, each left after a few updates."""
    values: dict[str, object] = {
        'courses__at_once': 3, 'courses__updates_each': 4, 'replay__rows_per_batch': 60,
        'replay__missions_per_batch': 6,
    }  # fmt: skip
    if preset == 'imitation':
        values['courses__per_update'] = 2
    return small(preset, **(values | overrides))
