"""What the paper says of its results (Sec. VII), statement by statement, in our words.

Each claim names the studies that it is judged by and what is measured for it; how much is much,
and how near is equal, is said beside the number.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

from uav_collect.studies.claims import learning, tests
from uav_collect.studies.claims.judging import ClaimStatus, combined_status, Evidence, StudyResults
from uav_collect.studies.findings import Findings
from uav_collect.studies.study import Study


@dataclass(frozen=True, kw_only=True)
class Claim:
    """A statement of the paper, and the function that measures it."""

    figure: int
    statement: str
    studies: tuple[str, ...]  # that it takes
    evidence: Callable[[StudyResults], Iterable[Evidence]]


@dataclass(frozen=True, kw_only=True)
class JudgedClaim:
    """A claim, what was measured for it, and what follows from that."""

    claim: Claim
    evidence: tuple[Evidence, ...]
    status: ClaimStatus


CLAIMS = (
    Claim(
        figure=4,
        statement='AQMIX learns more than QMIX and AIQL on areas of every size.',
        studies=('learning-areas',),
        evidence=learning.aqmix_above_in_every_area,
    ),
    Claim(
        figure=4,
        statement='QMIX falls behind since its UAVs wait, hovering, while they learn.',
        studies=('learning-areas',),
        evidence=learning.waiting_costs_energy,
    ),
    Claim(
        figure=4,
        statement='AQMIX and QMIX learn alike from every seed, AIQL varies much more.',
        studies=('learning-areas',),
        evidence=learning.aiql_varies_more,
    ),
    Claim(
        figure=5,
        statement='With one UAV all three algorithms learn the same.',
        studies=('learning-uavs',),
        evidence=learning.alike_with_one_uav,
    ),
    Claim(
        figure=5,
        statement='The more UAVs, the further AQMIX is ahead; it is the best with several.',
        studies=('learning-uavs',),
        evidence=learning.gaps_grow_with_uavs,
    ),
    Claim(
        figure=5,
        statement='AIQL learns much less the more UAVs there are.',
        studies=('learning-uavs',),
        evidence=learning.aiql_drops_with_uavs,
    ),
    Claim(
        figure=6,
        statement='150 kJ for each UAV are enough for AQMIX, QMIX and HERT to collect all data.',
        studies=('energy',),
        evidence=tests.enough_energy,
    ),
    Claim(
        figure=6,
        statement='AIQL needs more than 400 kJ to collect all data.',
        studies=('energy',),
        evidence=tests.aiql_needs_more_energy,
    ),
    Claim(
        figure=6,
        statement='Energy beyond what is needed changes neither time nor efficiency.',
        studies=('energy',),
        evidence=tests.more_energy_changes_nothing,
    ),
    Claim(
        figure=6,
        statement='AQMIX is the best in data collected, time and efficiency.',
        studies=('energy',),
        evidence=tests.aqmix_best_over_budgets,
    ),
    Claim(
        figure=7,
        statement='Time and efficiency rise with the density of the demand.',
        studies=('density',),
        evidence=tests.rising_with_density,
    ),
    Claim(
        figure=7,
        statement='AQMIX is better than the others at every density.',
        studies=('density',),
        evidence=tests.aqmix_best_over_densities,
    ),
    Claim(
        figure=8,
        statement='More UAVs make AQMIX and QMIX faster and less efficient.',
        studies=('uavs',),
        evidence=tests.faster_but_less_efficient,
    ),
    Claim(
        figure=8,
        statement='From one UAV to two AQMIX takes about 75 % less time and loses less than 10 % '
        'of its efficiency.',
        studies=('uavs',),
        evidence=tests.second_uav_of_aqmix,
    ),
    Claim(
        figure=8,
        statement='From one UAV to two QMIX takes 50 % less time and loses 30 % of its '
        'efficiency.',
        studies=('uavs',),
        evidence=tests.second_uav_of_qmix,
    ),
    Claim(
        figure=8,
        statement="HERT's time falls in proportion to the number of UAVs, its efficiency stays.",
        studies=('uavs',),
        evidence=tests.hert_in_proportion,
    ),
    Claim(
        figure=8,
        statement='AIQL is poor with more than two UAVs.',
        studies=('uavs',),
        evidence=tests.aiql_poor_with_many,
    ),
    Claim(
        figure=8,
        statement='AQMIX has the shortest time and the highest efficiency with any number of '
        'UAVs.',
        studies=('uavs',),
        evidence=tests.aqmix_best_over_fleets,
    ),
    Claim(
        figure=9,
        statement='HERT does not depend on the communication range.',
        studies=('range',),
        evidence=tests.hert_without_radio,
    ),
    Claim(
        figure=9,
        statement='AQMIX and QMIX get faster and more efficient with the range.',
        studies=('range',),
        evidence=tests.better_with_range,
    ),
    Claim(
        figure=9,
        statement='AIQL gains nothing from more range.',
        studies=('range',),
        evidence=tests.aiql_without_gain,
    ),
    Claim(
        figure=9,
        statement='AQMIX is the best at every range.',
        studies=('range',),
        evidence=tests.aqmix_best_over_ranges,
    ),
    Claim(
        figure=10,
        statement='A kernel of 3x3, as wide as a UAV sees, learns best; none and very large ones '
        'learn less.',
        studies=('kernel',),
        evidence=learning.middle_kernel_best,
    ),
    Claim(
        figure=11,
        statement='The optimal bandwidth is better than the equal one at every channel error.',
        studies=('csi',),
        evidence=tests.optimal_better,
    ),
    Claim(
        figure=11,
        statement='The optimal bandwidth is robust against channel errors.',
        studies=('csi',),
        evidence=tests.robust_to_errors,
    ),
    Claim(
        figure=12,
        statement='At low density the gain of the optimal bandwidth is marginal.',
        studies=('bandwidth',),
        evidence=tests.marginal_gain_when_sparse,
    ),
    Claim(
        figure=12,
        statement='The gain of the optimal bandwidth grows with the density.',
        studies=('bandwidth',),
        evidence=tests.gain_grows_with_density,
    ),
    Claim(
        figure=13,
        statement='UAVs of AQMIX share the area: their ways overlap less than those of QMIX and '
        'AIQL.',
        studies=('trajectories',),
        evidence=tests.less_overlap,
    ),
)


def judge(studies: Mapping[str, Study], findings: Findings) -> tuple[JudgedClaim, ...]:
    """Judge every claim whose studies are there; the others are not run."""
    results = StudyResults(studies, findings)
    judged = []
    for claim in CLAIMS:
        is_run = all(name in studies for name in claim.studies)
        evidence = tuple(claim.evidence(results)) if is_run else ()
        judged.append(
            JudgedClaim(claim=claim, evidence=evidence, status=combined_status(evidence))
        )
    return tuple(judged)
