"""What the paper says of its results (Sec. VII), statement by statement, in our words.

Each claim names the study that it is judged by and what is measured for it; how much is much,
and how near is equal, is said beside the number.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

from uav_collect.studies.claims import learning, missions
from uav_collect.studies.claims.judging import ClaimStatus, combined_status, Evidence, StudyResults
from uav_collect.studies.findings import Findings
from uav_collect.studies.study import Study


@dataclass(frozen=True, kw_only=True)
class Claim:
    """A statement of the paper, and the function that measures it."""

    figure: int
    statement: str
    study: str  # that it is judged by
    evidence: Callable[[StudyResults], Iterable[Evidence]]
    note: str = ''  # what a reader of the verdict should know


@dataclass(frozen=True, kw_only=True)
class JudgedClaim:
    """A claim, what was measured for it, and what follows from that."""

    claim: Claim
    evidence: tuple[Evidence, ...]
    status: ClaimStatus


_SPEEDS = (
    'the paper gives speeds of two UAVs alone; here one flies at 5 m/s, and of more every second '
    'one at 10 m/s'
)
_NOTES = {
    learning.alike_with_one_uav: 'AQMIX and QMIX keep their mixer, which AIQL has not',
    missions.efficiency_brings_the_rest: 'nearly so by definition where nothing or all is left',
    missions.second_uav_of_aqmix: _SPEEDS,
    missions.second_uav_of_qmix: _SPEEDS,
    missions.better_trade_than_qmix: _SPEEDS,
    missions.hert_in_proportion: _SPEEDS,
}

CLAIMS = tuple(
    Claim(
        figure=figure, study=study, evidence=evidence, statement=statement,
        note=_NOTES.get(evidence, ''),
    )
    for figure, study, evidence, statement in (
        (4, 'learning-areas', learning.aqmix_above_in_every_area,
         'AQMIX learns more than QMIX and AIQL on areas of every size.'),
        (4, 'learning-areas', learning.waiting_costs_energy,
         'QMIX falls behind since its UAVs wait, hovering, while they learn.'),
        (4, 'learning-areas', learning.aiql_varies_more,
         'AQMIX and QMIX learn alike from every seed, AIQL varies much more.'),
        (5, 'learning-uavs', learning.alike_with_one_uav,
         'With one UAV all three algorithms learn the same.'),
        (5, 'learning-uavs', learning.gaps_grow_with_uavs,
         'The more UAVs, the further AQMIX is ahead; it is the best with several.'),
        (5, 'learning-uavs', learning.aiql_drops_with_uavs,
         'AIQL learns much less the more UAVs there are.'),
        (6, 'energy', missions.enough_energy,
         '150 kJ for each UAV are enough for AQMIX, QMIX and HERT to collect all data.'),
        (6, 'energy', missions.aiql_needs_more_energy,
         'AIQL needs more than 400 kJ to collect all data.'),
        (6, 'energy', missions.more_energy_changes_nothing,
         'Energy beyond what is needed changes neither time nor efficiency.'),
        (6, 'energy', missions.aqmix_best_over_budgets,
         'AQMIX is the best in data collected, time and efficiency.'),
        (6, 'energy', missions.aqmix_uses_least_energy,
         'AQMIX uses the least energy.'),
        (6, 'energy', missions.efficiency_brings_the_rest,
         'Time and collected data are optimised by energy efficiency alone.'),
        (7, 'density', missions.rising_with_density,
         'Time and efficiency rise with the density of the demand.'),
        (7, 'density', missions.aqmix_best_over_densities,
         'AQMIX is better than the others at every density.'),
        (7, 'density', missions.complete_at_every_density,
         'AQMIX generalises: trained at one density, it collects all data at every one.'),
        (8, 'uavs', missions.faster_but_less_efficient,
         'More UAVs make AQMIX and QMIX faster and less efficient.'),
        (8, 'uavs', missions.second_uav_of_aqmix,
         'From one UAV to two AQMIX takes about 75 % less time and loses less than 10 % of its '
         'efficiency.'),
        (8, 'uavs', missions.second_uav_of_qmix,
         'From one UAV to two QMIX takes 50 % less time and loses 30 % of its efficiency.'),
        (8, 'uavs', missions.better_trade_than_qmix,
         'AQMIX trades efficiency for time much better than QMIX.'),
        (8, 'uavs', missions.overlap_costs_efficiency,
         'From two UAVs on, efficiency falls with their number since their ways overlap.'),
        (8, 'uavs', missions.hert_in_proportion,
         "HERT's time falls in proportion to the number of UAVs, its efficiency stays."),
        (8, 'uavs', missions.aiql_poor_with_many,
         'AIQL is poor with more than two UAVs.'),
        (8, 'uavs', missions.aqmix_best_over_fleets,
         'AQMIX has the shortest time and the highest efficiency with any number of UAVs.'),
        (9, 'range', missions.hert_without_radio,
         'HERT does not depend on the communication range.'),
        (9, 'range', missions.better_with_range,
         'AQMIX and QMIX get faster and more efficient with the range.'),
        (9, 'range', missions.aiql_without_gain,
         'AIQL gains nothing from more range.'),
        (9, 'range', missions.aqmix_best_over_ranges,
         'AQMIX is the best at every range.'),
        (10, 'kernel', learning.middle_kernel_best,
         'A kernel of 3x3, as wide as a UAV sees, learns best; none and very large ones learn '
         'less.'),
        (10, 'kernel', learning.pooling_saves,
         'Pooling makes the mixing network smaller and training shorter.'),
        (11, 'csi', missions.optimal_better,
         'The optimal bandwidth is better than the equal one at every channel error.'),
        (11, 'csi', missions.robust_to_errors,
         'The optimal bandwidth is robust against channel errors.'),
        (12, 'bandwidth', missions.marginal_gain_when_sparse,
         'At low density the gain of the optimal bandwidth is marginal.'),
        (12, 'bandwidth', missions.gain_grows_with_density,
         'The gain of the optimal bandwidth grows with the density and becomes substantial.'),
        (13, 'trajectories', missions.less_overlap,
         'UAVs of AQMIX share the area: their ways overlap less than those of QMIX and AIQL.'),
    )
)  # fmt: skip


def judge(studies: Mapping[str, Study], findings: Findings) -> tuple[JudgedClaim, ...]:
    """Judge every claim whose study is there; the others are not run."""
    results = StudyResults(studies, findings)
    judged = []
    for claim in CLAIMS:
        evidence = tuple(claim.evidence(results)) if claim.study in studies else ()
        judged.append(
            JudgedClaim(claim=claim, evidence=evidence, status=combined_status(evidence))
        )
    return tuple(judged)
