"""What the rules promise: HERT's order, the sweep's margin over it, an end to every mission."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
import hashlib

from fleets import flown_without
from interpreted import interpreted
import numpy as np
import odd_areas
import pytest
from uav_collect.analysis.metrics import mission_metrics
from uav_collect.kernels.arrays import Row
from uav_collect.missions.rollout import fly
from uav_collect.recording.mission_log import MissionLog
from uav_collect.scenario.load import load
from uav_collect.scenario.model import Scenario
from uav_collect.scenario.site import build_site
from uav_collect.uav.action_codes import HOME, N_ACTIONS, REASON_NAMES
from uav_collect.uav.belief import Belief
from uav_collect.uav.briefing import brief, Briefing
from uav_collect.uav.heuristics import Heuristic, sector_start
from uav_collect.uav.policy import Policy, policy_named
from uav_collect.uav.view import LocalView

SPEEDS_MPS = ([5.0], [5.0, 10.0], [10.0, 5.0], [5.0, 5.0, 5.0], [5.0, 10.0, 7.5, 12.0, 3.0])
RULES = tuple(rule.label for rule in Heuristic)
HOLE = [[150.0, 150.0], [250.0, 150.0], [250.0, 250.0], [150.0, 250.0]]  # cells of 50 m


def scenario_of(
    speeds_mps: Sequence[float], name: str = 'paper_10x10', **overrides: object
) -> Scenario:
    fleet = [{'speed_mps': speed_mps} for speed_mps in speeds_mps]
    dotted = {key.replace('__', '.'): value for key, value in overrides.items()}
    return load(name, {'fleet.uavs': fleet, **dotted})


def logs(
    scenario: Scenario,
    policy: str | Callable[[], Policy],
    n_missions: int,
    allocator: str = 'equal',
) -> list[MissionLog]:
    return fly(build_site(scenario), range(n_missions), policy, allocator)


def mean_efficiency(flown: Sequence[MissionLog]) -> float:
    return float(np.mean([mission_metrics(log).efficiency_kbit_per_j for log in flown]))


def mean_time_s(flown: Sequence[MissionLog]) -> float:
    return float(np.mean([mission_metrics(log).completion_s for log in flown]))


def way(log: MissionLog, uav: int) -> list[int]:
    """The cells that a UAV comes to, from its start on."""
    head = log.header
    own = log.events[log.events['uav'] == uav + 1]
    rows = (own['y_m'] / head.cell_size_m).astype(int)
    columns = (own['x_m'] / head.cell_size_m).astype(int)
    cells: list[int] = (rows * head.n_columns + columns).tolist()
    return [cell for cell, before in zip(cells, [-1, *cells], strict=False) if cell != before]


def up_one_column_and_down_the_next(side: int) -> list[int]:
    upwards = range(side)
    return [
        row * side + column
        for column in range(side)
        for row in (upwards if column % 2 == 0 else reversed(upwards))
    ]


@pytest.mark.parametrize('speeds_mps', SPEEDS_MPS)
@pytest.mark.parametrize('rule', [Heuristic.HERT, Heuristic.HERT_EQUAL])
def test_hert_comes_to_every_cell_of_its_sector_once_in_boustrophedon_order(
    rule: Heuristic, speeds_mps: list[float]
) -> None:
    # Without a radio no UAV learns early that nothing is left.
    scenario = scenario_of(speeds_mps, radio__contact_range_m=0.0)
    briefing, path = brief(scenario), up_one_column_and_down_the_next(10)
    for log in logs(scenario, rule.label, 3):
        for uav in range(len(speeds_mps)):
            start = sector_start(briefing, uav, 100, rule == Heuristic.HERT)
            stop = sector_start(briefing, uav + 1, 100, rule == Heuristic.HERT)
            flown, sector = way(log, uav), path[start:stop]
            if len(speeds_mps) == 1:
                sector = sector[: len(flown)]  # alone it sees the last cells from their neighbours
            assert flown[-len(sector) :] == sector
            assert not set(flown[: -len(sector)]) & set(sector)


@pytest.mark.parametrize('by_speed', [True, False])
@pytest.mark.parametrize('speeds_mps', SPEEDS_MPS)
def test_sectors_join_and_are_in_proportion(speeds_mps: list[float], by_speed: bool) -> None:
    briefing = brief(scenario_of(speeds_mps))
    weights = np.array(speeds_mps) if by_speed else np.ones(len(speeds_mps))
    for n_stops in (1, 7, 100, 400):
        bounds = [
            sector_start(briefing, uav, n_stops, by_speed) for uav in range(len(speeds_mps) + 1)
        ]
        assert bounds[0] == 0
        assert bounds[-1] == n_stops
        assert bounds == sorted(bounds)
        assert np.abs(np.diff(bounds) - n_stops * weights / weights.sum()).max() <= 1.0


@pytest.mark.parametrize(
    ('name', 'speeds_mps', 'gain'),
    [
        ('paper_10x10', [5.0, 10.0], 1.4),
        ('paper_8x8', [5.0, 10.0], 1.35),
        ('paper_10x10', [5.0], 1.4),
        ('paper_10x10', [10.0, 5.0, 10.0, 5.0], 1.15),
    ],
)
def test_the_sweep_is_more_efficient_and_faster_than_hert(
    name: str, speeds_mps: list[float], gain: float
) -> None:
    scenario = scenario_of(speeds_mps, name)
    sweep, hert = logs(scenario, 'sweep', 200), logs(scenario, 'hert', 200)
    assert mean_efficiency(sweep) > gain * mean_efficiency(hert)
    assert mean_time_s(sweep) < 0.75 * mean_time_s(hert)


def test_the_sweep_uses_what_it_hears() -> None:
    # At 10 m it is heard as good as never; whoever hopes for news then looks for itself.
    deaf, hearing = (
        logs(scenario_of([5.0, 10.0], radio__contact_range_m=range_m), 'sweep', 200)
        for range_m in (10.0, np.inf)
    )
    assert mean_efficiency(hearing) > 1.3 * mean_efficiency(deaf)


@pytest.mark.parametrize('n_uavs', [2, 3, 4, 6])
@pytest.mark.parametrize('name', ['paper_8x8', 'paper_10x10'])
def test_without_a_radio_the_sweep_trusts_the_others_and_is_ahead_of_hert(
    name: str, n_uavs: int
) -> None:
    scenario = scenario_of(
        [5.0, 10.0, 5.0, 10.0, 5.0, 10.0][:n_uavs], name, radio__contact_range_m=0.0
    )
    sweep, hert = logs(scenario, 'sweep', 100), logs(scenario, 'hert', 100)
    assert mean_efficiency(sweep) > 1.15 * mean_efficiency(hert)
    assert mean_time_s(sweep) < 0.85 * mean_time_s(hert)
    for log in sweep:
        assert mission_metrics(log).is_complete
        served = log.events[log.events['collected_bit'] > 0]
        assert len(served) == len({*zip(served['x_m'], served['y_m'], strict=True)})


@pytest.mark.parametrize('speeds_mps', SPEEDS_MPS)
def test_without_a_radio_all_cells_are_somebodys(speeds_mps: list[float]) -> None:
    for side in (1, 2, 3, 7, 10):
        scenario = scenario_of(
            speeds_mps,
            radio__contact_range_m=0.0,
            area__cells_per_side=side,
            demand__cell_share=0.9,
        )
        for log in logs(scenario, 'sweep', 10):
            assert mission_metrics(log).is_complete


@pytest.mark.parametrize('gone', [0, 1, 2])
def test_the_sweep_looks_for_itself_where_a_part_is_nobodys(gone: int) -> None:
    # The fastest of three has a piece of its own; the two others share theirs.
    scenario = scenario_of([5.0, 7.5, 10.0])
    usual_s = mean_time_s(logs(scenario, 'sweep', 20))
    for seed in range(20):
        mission = mission_metrics(flown_without(scenario, seed, 'sweep', uav=gone, since=0))
        assert mission.is_complete
        assert mission.completion_s < 3.0 * usual_s


def test_the_sweep_flies_as_well_whichever_uav_is_the_slow_one() -> None:
    first, second = (
        mean_efficiency(logs(scenario_of(speeds_mps), 'sweep', 200))
        for speeds_mps in ([5.0, 10.0], [10.0, 5.0])
    )
    assert first == pytest.approx(second, rel=0.02)


def test_the_sweep_flies_as_well_from_every_corner() -> None:
    here, *others = (
        mean_time_s(
            logs(
                scenario_of([5.0, 10.0], fleet__default__start=at, fleet__default__home=at),
                'sweep',
                200,
            )
        )
        for at in ({'cell': [row, column]} for row in (0, 9) for column in (0, 9))
    )
    assert others == pytest.approx([here] * 3, rel=0.03)


@pytest.mark.parametrize('border', ['east', 'north', 'both'])
@pytest.mark.parametrize('has_hole', [False, True])
def test_a_home_on_the_areas_border_is_flown_to_as_one_just_inside(
    border: str, has_hole: bool
) -> None:
    width_m, height_m = (600.0, 300.0) if has_hole else (500.0, 500.0)
    on_m = width_m if border != 'north' else 25.0, height_m if border != 'east' else 25.0

    def flown(home_m: Sequence[float]) -> list[int]:
        home = {'position_m': [*home_m]}
        fleet = [{'speed_mps': speed_mps, 'home': home} for speed_mps in (3.0, 10.0, 12.0)]
        values = {'fleet.uavs': fleet, 'radio.contact_range_m': 100.0}
        if has_hole:
            scenario = odd_areas.corridor(6, 12, **{'area.no_fly': [HOLE], **values})
        else:
            scenario = load('paper_10x10', values)
        actions: list[int] = logs(scenario, 'sweep', 1)[0].events['action'].tolist()
        return actions

    assert flown(on_m) == flown([place_m - 1e-6 for place_m in on_m])


@pytest.mark.parametrize('range_m', [50.0, 200.0])
@pytest.mark.parametrize('n_uavs', [1, 2, 3, 6])
def test_with_energy_to_spare_the_sweep_ends_with_all_collected_and_each_map_complete(
    n_uavs: int, range_m: float
) -> None:
    scenario = scenario_of(
        [5.0, 10.0, 8.0, 5.0, 10.0, 8.0][:n_uavs], radio__contact_range_m=range_m
    )
    for log in logs(scenario, 'sweep', 50):
        turns = log.events[log.events['action'] == HOME]
        assert {REASON_NAMES[reason] for reason in turns['reason']} == {'map complete'}
        assert mission_metrics(log).collected_share == pytest.approx(1.0)


@pytest.mark.parametrize('rule', RULES)
@pytest.mark.parametrize('budget_kj', [15.0, 60.0, 1000.0])
def test_every_rule_ends_every_mission(rule: str, budget_kj: float) -> None:
    for speeds_mps in SPEEDS_MPS:
        for range_m in (0.0, 200.0):
            scenario = scenario_of(
                speeds_mps,
                radio__contact_range_m=range_m,
                fleet__default__energy_budget_kj=budget_kj,
            )
            for log in logs(scenario, rule, 10):
                assert (log.events['action'] == HOME).sum() == len(speeds_mps)
                if rule != 'random':
                    assert np.bincount(log.events['uav']).max() < 350


@pytest.mark.parametrize('overrides', [{'area__cells_per_side': 1}, {'area__cells_per_side': 2}])
def test_the_sweep_copes_with_areas_narrower_than_a_lane(overrides: dict[str, object]) -> None:
    for speeds_mps in SPEEDS_MPS:
        for log in logs(scenario_of(speeds_mps, **overrides), 'sweep', 10):
            assert mission_metrics(log).collected_share == pytest.approx(1.0)


@dataclass
class Watched:
    """A rule that fails where it chooses what is not legal."""

    rule: Policy
    name: str = 'watched'
    version: str = '1'

    def begin(self, briefing: Briefing, uav: int) -> None:
        self.rule.begin(briefing, uav)

    def choose(self, belief: Belief, view: LocalView, legal: Row[int]) -> int:
        action = self.rule.choose(belief, view, legal)
        assert action == HOME or (0 <= action < N_ACTIONS and legal[action] == 1)
        return action


@pytest.mark.parametrize('rule', RULES)
def test_rules_choose_legal_actions_only(rule: str) -> None:
    for budget_kj in (20.0, 60.0):
        scenario = scenario_of([5.0, 10.0, 7.5], fleet__default__energy_budget_kj=budget_kj)
        logs(scenario, lambda: Watched(policy_named(rule)), 10)


def flown_by_rules() -> str:
    """A digest of missions by all rules and several fleets."""
    digest = hashlib.sha256()
    for speeds_mps in SPEEDS_MPS:
        for rule in RULES:
            for range_m in (0.0, 200.0):
                scenario = scenario_of(
                    speeds_mps,
                    radio__contact_range_m=range_m,
                    fleet__default__energy_budget_kj=80.0,
                )
                for log in logs(scenario, rule, 3):
                    digest.update(log.to_jsonl())
    for scenario in (odd_areas.with_a_hole(), odd_areas.pipeline(12)):
        for rule in RULES:
            digest.update(logs(scenario, rule, 1)[0].to_jsonl())
    return digest.hexdigest()


def test_rules_decide_the_same_compiled_and_interpreted() -> None:
    assert flown_by_rules() == interpreted(flown_by_rules)
