"""Each statement of the paper is judged the way its words point, by numbers that are made up.

A world says what each policy gives where: as the statement has it, the other way round, and with
nothing between the policies.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cache

import numpy as np
import pytest
from uav_collect.kernels.arrays import Floats
from uav_collect.studies.catalogue import make_study
from uav_collect.studies.claims import learning, missions
from uav_collect.studies.claims.claims import Claim, CLAIMS
from uav_collect.studies.claims.judging import (
    ClaimStatus,
    combined_status,
    Evidence,
    StudyResults,
)
from uav_collect.studies.findings import Column
from uav_collect.studies.requests import Requests
from uav_collect.studies.scale import load_scale, ScaleConfig
from uav_collect.studies.study import (
    AIQL,
    AQMIX,
    COLLECTED,
    COLLECTING,
    COMPLETION,
    CurvesStudy,
    EFFICIENCY,
    ENERGY,
    HERT,
    LEARNED,
    LinesStudy,
    MissionSet,
    PanelMeasure,
    QMIX,
    REWARD,
    Study,
    TrainedPolicies,
    TrajectoriesStudy,
)

OPTIMAL = f'{AQMIX}, optimal bandwidth'
HOLDS, FAILS, TIE, OPEN = ClaimStatus.HOLDS, ClaimStatus.FAILS, ClaimStatus.TIE, ClaimStatus.OPEN
N_MISSIONS = 20


@dataclass(frozen=True, kw_only=True)
class At:
    """Where a number is asked for."""

    label: str  # of a line or a curve
    over: float  # the value that the study runs over; of learning curves the number of the panel
    training: Floats  # (T, 1), from -1 to 1
    mission: Floats  # (1, M), from -1 to 1; (1, 1) of what is learned


_Number = Callable[[At], Floats | float]
World = Mapping[str, _Number]  # by column; what is not there is the same everywhere


def level(it: At) -> Floats:
    """One, but for the mission, which is everybody's, and a little for the training."""
    return 1.0 + 0.01 * it.mission + 0.001 * it.training


def times(factor: float | Callable[[float], float], *labels: str) -> _Number:
    """Some policies, or all, give so many times as much; everywhere, or by what is varied."""

    def number(it: At) -> Floats:
        if labels and it.label not in labels:
            return level(it)
        return level(it) * (factor(it.over) if callable(factor) else factor)

    return number


def share(value: float, *labels: str) -> _Number:
    """Some policies collect that share of the data, the others all."""
    return lambda it: value if it.label in labels else 1.0


class MadeUp:
    """Findings of one study, as a world has them."""

    def __init__(self, study: Study, world: World) -> None:
        self._world = {COLLECTED.key: share(1.0)} | world
        # With one UAV missions of QMIX are those of AQMIX, which stands before it.
        self._places = dict(reversed(places(study)))

    def column(self, tested: MissionSet, measure: PanelMeasure) -> Column:
        value = self.numbers(tested, measure.key) * measure.scale
        return Column(value=value, trainings=tested.trainings)

    def numbers(self, tested: MissionSet, key: str) -> Floats:
        return self._at(tested, max(1, len(tested.trainings)), N_MISSIONS, key)

    def final_values(self, trained: TrainedPolicies, key: str) -> Floats:
        return self._at(trained, len(trained.digests), 1, key)[:, 0]

    def n_parameters(self, trained: TrainedPolicies) -> int:
        return round(1e6 * self.final_values(trained, 'parameters').mean())

    def update_ms(self, trained: TrainedPolicies) -> Floats:
        return self.final_values(trained, 'update_ms')

    def _at(
        self, asked: MissionSet | TrainedPolicies, n_trainings: int, n_missions: int, key: str
    ) -> Floats:
        label, over = self._places[asked]
        training, mission = (
            np.linspace(-1.0, 1.0, n) if n > 1 else np.zeros(1) for n in (n_trainings, n_missions)
        )
        it = At(label=label, over=over, training=training[:, None], mission=mission[None])
        number = self._world.get(key, level)(it)
        return np.broadcast_to(np.asarray(number), (n_trainings, n_missions))


def places(study: Study) -> list[tuple[MissionSet | TrainedPolicies, tuple[str, float]]]:
    """Where each of the things stands that a study asks for numbers of."""
    match study:
        case LinesStudy():
            return [
                (tested, (line.label, value))
                for line in study.lines
                for value, tested in zip(study.values, line.tests, strict=True)
            ]
        case CurvesStudy():
            return [
                (curve, (curve.label, float(number)))
                for number, panel in enumerate(study.panels)
                for curve in panel.curves
            ]
        case TrajectoriesStudy():
            return [(tested, (label, 0.0)) for label, tested in study.tests.items()]
    raise TypeError(f'no statement is judged by {study.name}')


@cache
def study_named(name: str) -> Study:
    return make_study(name, Requests(scale=_scale()))


@cache
def _scale() -> ScaleConfig:
    return load_scale('laptop')


def evidence_in(claim: Claim, world: World) -> tuple[Evidence, ...]:
    """What is measured for a claim in a world, which has nothing but the claim's study."""
    study = study_named(claim.study)
    results = StudyResults({claim.study: study}, MadeUp(study, world))
    return tuple(claim.evidence(results))


BEST = {
    COMPLETION.key: times(0.8, AQMIX),
    EFFICIENCY.key: times(1.2, AQMIX),
    ENERGY.key: times(0.8, AQMIX),
    COLLECTED.key: share(0.8, QMIX, AIQL, HERT),
}
WORST = {
    COMPLETION.key: times(1.2, AQMIX),
    EFFICIENCY.key: times(0.8, AQMIX),
    ENERGY.key: times(1.2, AQMIX),
    COLLECTED.key: share(0.8, AQMIX),
}
FLAT: World = {}
TRAINING_EFFICIENCY = 'training_efficiency_kbit_per_j'


@dataclass(frozen=True, kw_only=True)
class Case:
    """What a statement is judged by."""

    holds: World
    fails: tuple[World, ...]  # each by itself
    tie: World = field(default_factory=dict)  # where nothing is between the policies
    tied: ClaimStatus = TIE  # how that is judged


def second_uav(time: float, efficiency: float) -> World:
    """Time and efficiency of two UAVs, in those of one."""
    return trade((time, efficiency), (time, efficiency))


def trade(aqmix: tuple[float, float], qmix: tuple[float, float]) -> World:
    """Time and efficiency of two UAVs, in those of one."""

    def number(index: int) -> _Number:
        factors = {AQMIX: aqmix[index], QMIX: qmix[index]}
        return lambda it: level(it) * (factors.get(it.label, 1.0) if it.over == 2 else 1.0)

    return {COMPLETION.key: number(0), EFFICIENCY.key: number(1)}


def crowd(overlap: float, efficiency: float, together: float = 0.1) -> World:
    """What each UAV adds to overlap and efficiency; more of one and less of other by mission."""
    return {
        'shared_cells': lambda it: 0.5 + it.over * (overlap + 0.01 * it.mission),
        'visited_cells': lambda it: 1.0 + 0.0 * it.mission,
        EFFICIENCY.key: lambda it: 9.0 + it.over * (efficiency - together * it.mission),
    }


def ordered(time: float, collected: float) -> World:
    """How time and data go with the efficiency of trainings' policies."""

    def rank(it: At) -> Floats:
        return 1.0 + 0.1 * it.training + 0.01 * [*LEARNED].index(it.label) + 0.0 * it.mission

    return {
        EFFICIENCY.key: rank,
        COMPLETION.key: lambda it: 2.0 + time * rank(it),
        COLLECTED.key: lambda it: 0.5 + 0.1 * collected * rank(it),
    }


def spread(**widths: float) -> World:
    """How far an algorithm's trainings lie from their mean."""
    return {REWARD.key: lambda it: 1.0 + widths.get(it.label, 0.01) * it.training}


CASES = {
    learning.aqmix_above_in_every_area: Case(
        holds={REWARD.key: times(1.2, AQMIX)}, fails=({REWARD.key: times(0.8, AQMIX)},)
    ),
    learning.waiting_costs_energy: Case(
        holds={TRAINING_EFFICIENCY: times(0.8, QMIX)},
        fails=({TRAINING_EFFICIENCY: times(1.2, QMIX)},),
    ),
    learning.aiql_varies_more: Case(
        holds=spread(AIQL=0.5),
        fails=(spread(AQMIX=0.5, QMIX=0.5),),
        tied=OPEN,  # nobody knows the deviation of six within 2 %
    ),
    learning.alike_with_one_uav: Case(
        holds=FLAT,
        fails=({EFFICIENCY.key: times(0.8, AIQL)}, {EFFICIENCY.key: times(1.2, AIQL)}),
        tied=HOLDS,
    ),
    learning.gaps_grow_with_uavs: Case(
        holds={REWARD.key: times(lambda panel: 1.0 + 0.2 * panel, AQMIX)},
        fails=(
            {REWARD.key: times(lambda panel: 1.0 - 0.2 * panel, AQMIX)},
            {REWARD.key: times(lambda panel: 2.0 - 0.2 * panel, AQMIX)},
        ),
    ),
    learning.aiql_drops_with_uavs: Case(
        holds={EFFICIENCY.key: times(lambda panel: 1.0 - 0.2 * panel, AIQL)},
        fails=({EFFICIENCY.key: times(lambda panel: 0.4 + 0.2 * panel, AIQL)},),
    ),
    missions.enough_energy: Case(
        holds=FLAT,
        fails=tuple({COLLECTED.key: share(0.9, label)} for label in (AQMIX, QMIX, HERT)),
        tied=HOLDS,
    ),
    missions.aiql_needs_more_energy: Case(
        holds={COLLECTED.key: share(0.9, AIQL)}, fails=(FLAT,), tied=FAILS
    ),
    missions.more_energy_changes_nothing: Case(
        holds=BEST,
        fails=tuple(
            {measure.key: times(lambda budget_kj, factor=factor: 1 if budget_kj < 200 else factor)}
            for measure in (COMPLETION, EFFICIENCY)
            for factor in (0.8, 1.2)
        ),
        tied=HOLDS,
    ),
    missions.aqmix_best_over_budgets: Case(holds=BEST, fails=(WORST,)),
    missions.aqmix_uses_least_energy: Case(holds=BEST, fails=(WORST,)),
    missions.efficiency_brings_the_rest: Case(
        holds=ordered(-1.0, 1.0),
        fails=(ordered(1.0, 1.0), ordered(-1.0, -1.0)),
        tie=ordered(0.0, 0.0),
        tied=OPEN,  # what is the same of all has no order
    ),
    missions.rising_with_density: Case(
        holds={it.key: times(lambda density: 1.0 + density) for it in (COMPLETION, EFFICIENCY)},
        fails=(
            {COMPLETION.key: times(lambda density: 2.0 - density)},
            {EFFICIENCY.key: times(lambda density: 2.0 - density)},
        ),
    ),
    missions.aqmix_best_over_densities: Case(holds=BEST, fails=(WORST,)),
    missions.complete_at_every_density: Case(
        holds={COLLECTED.key: share(0.9, QMIX, AIQL)},
        fails=({COLLECTED.key: share(0.9, AQMIX)},),
        tied=HOLDS,
    ),
    missions.faster_but_less_efficient: Case(
        holds={it.key: times(lambda n_uavs: 1.0 / n_uavs) for it in (COMPLETION, EFFICIENCY)},
        fails=({COMPLETION.key: times(float)}, {EFFICIENCY.key: times(float)}),
    ),
    missions.second_uav_of_aqmix: Case(
        holds=second_uav(0.25, 0.95),
        fails=(second_uav(0.5, 0.95), second_uav(0.25, 1.2), second_uav(0.25, 0.7)),
        tied=FAILS,  # which is no less time
    ),
    missions.second_uav_of_qmix: Case(
        holds=second_uav(0.5, 0.7),
        fails=(second_uav(0.25, 0.7), second_uav(0.5, 0.95), second_uav(0.5, 1.3)),
        tied=FAILS,
    ),
    missions.better_trade_than_qmix: Case(
        holds=trade(aqmix=(0.25, 0.95), qmix=(0.5, 0.7)),
        fails=(
            trade(aqmix=(0.5, 0.7), qmix=(0.25, 0.95)),
            trade(aqmix=(1.5, 0.7), qmix=(0.5, 0.7)),  # who loses both has traded nothing
            trade(aqmix=(0.5, 1.1), qmix=(0.5, 1.1)),
        ),
        tie=trade(aqmix=(0.5, 0.8), qmix=(0.5, 0.8)),
    ),
    missions.overlap_costs_efficiency: Case(
        holds=crowd(0.05, -0.5),
        fails=(crowd(-0.05, -0.5), crowd(0.05, 0.5), crowd(0.05, -0.5, together=-0.1)),
        tied=OPEN,  # what does not change goes with nothing
    ),
    missions.hert_in_proportion: Case(
        holds={COMPLETION.key: times(lambda n_uavs: 1.0 / n_uavs, HERT)},
        fails=(
            FLAT,
            {it.key: times(lambda n_uavs: 1.0 / n_uavs, HERT) for it in (COMPLETION, EFFICIENCY)},
        ),
        tied=FAILS,  # as many times the time is more than the same
    ),
    missions.aiql_poor_with_many: Case(
        holds={EFFICIENCY.key: times(0.8, AIQL)}, fails=({EFFICIENCY.key: times(1.2, AIQL)},)
    ),
    missions.aqmix_best_over_fleets: Case(holds=BEST, fails=(WORST,)),
    missions.hert_without_radio: Case(
        holds=BEST,
        fails=tuple(
            {measure.key: times(lambda range_m, factor=factor: factor if range_m else 1.0, HERT)}
            for measure in (COMPLETION, EFFICIENCY)
            for factor in (0.8, 1.2)
        ),
        tied=HOLDS,
    ),
    missions.better_with_range: Case(
        holds={
            COMPLETION.key: times(lambda range_m: 0.8 if range_m else 1.0),
            EFFICIENCY.key: times(lambda range_m: 1.2 if range_m else 1.0),
        },
        fails=(
            {COMPLETION.key: times(lambda range_m: 1.2 if range_m else 1.0)},
            {EFFICIENCY.key: times(lambda range_m: 0.8 if range_m else 1.0)},
        ),
    ),
    missions.aiql_without_gain: Case(
        holds={EFFICIENCY.key: times(lambda range_m: 0.8 if range_m else 1.0, AIQL)},
        fails=({EFFICIENCY.key: times(lambda range_m: 1.2 if range_m else 1.0, AIQL)},),
        tied=HOLDS,
    ),
    missions.aqmix_best_over_ranges: Case(holds=BEST, fails=(WORST,)),
    learning.middle_kernel_best: Case(
        holds={REWARD.key: times(1.2, '3x3')}, fails=({REWARD.key: times(0.8, '3x3')},)
    ),
    learning.pooling_saves: Case(
        holds={'parameters': times(0.8, '3x3'), 'update_ms': times(0.8, '3x3')},
        fails=({'parameters': times(1.2, '3x3')}, {'update_ms': times(1.2, '3x3')}),
    ),
    missions.optimal_better: Case(
        holds={COLLECTING.key: times(0.8, OPTIMAL), EFFICIENCY.key: times(1.2, OPTIMAL)},
        fails=({COLLECTING.key: times(1.2, OPTIMAL)}, {EFFICIENCY.key: times(0.8, OPTIMAL)}),
    ),
    missions.robust_to_errors: Case(
        holds={EFFICIENCY.key: times(lambda error: 1.2 if error else 1.0)},
        fails=({EFFICIENCY.key: times(lambda error: 0.8 if error else 1.0)},),
        tied=HOLDS,
    ),
    missions.marginal_gain_when_sparse: Case(
        holds={EFFICIENCY.key: times(lambda density: 1.0 if density < 0.2 else 1.2, OPTIMAL)},
        fails=({EFFICIENCY.key: times(1.2, OPTIMAL)}, {EFFICIENCY.key: times(0.8, OPTIMAL)}),
        tied=HOLDS,
    ),
    missions.gain_grows_with_density: Case(
        holds={EFFICIENCY.key: times(lambda density: 1.0 + density, OPTIMAL)},
        fails=(
            {EFFICIENCY.key: times(lambda density: 2.0 - density, OPTIMAL)},
            {EFFICIENCY.key: times(lambda density: 0.5 + density, OPTIMAL)},
        ),
        tied=FAILS,  # which is no gain
    ),
    missions.less_overlap: Case(
        holds={'shared_cells': times(0.5, AQMIX)}, fails=({'shared_cells': times(1.5, AQMIX)},)
    ),
}


def test_every_statement_has_a_case() -> None:
    assert {claim.evidence for claim in CLAIMS} == set(CASES)
    assert len(CASES) == len(CLAIMS) == 34


def name_of(claim: Claim) -> str:
    return claim.evidence.__name__


@pytest.mark.parametrize('claim', CLAIMS, ids=name_of)
def test_a_statement_holds_where_all_is_as_it_says(claim: Claim) -> None:
    evidence = evidence_in(claim, CASES[claim.evidence].holds)
    assert {it.status for it in evidence} <= {HOLDS, ClaimStatus.SAME}, evidence
    assert combined_status(evidence) is HOLDS


@pytest.mark.parametrize('claim', CLAIMS, ids=name_of)
def test_a_statement_does_not_hold_where_something_is_the_other_way_round(claim: Claim) -> None:
    for world in CASES[claim.evidence].fails:
        evidence = evidence_in(claim, world)
        assert combined_status(evidence) is FAILS, evidence


@pytest.mark.parametrize('claim', CLAIMS, ids=name_of)
def test_a_statement_of_who_is_better_is_a_tie_where_nothing_differs(claim: Claim) -> None:
    case = CASES[claim.evidence]
    evidence = evidence_in(claim, case.tie)
    assert combined_status(evidence) is case.tied, evidence


def test_what_is_given_for_no_time_at_all_has_no_price() -> None:
    [claim] = (it for it in CLAIMS if it.evidence is missions.better_trade_than_qmix)
    *_, price = evidence_in(claim, FLAT)
    assert (price.status, price.estimate) == (OPEN, None)
