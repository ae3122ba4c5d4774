"""The document shows what decides a statement, and says how many statements do what."""

from collections.abc import Sequence

from uav_collect.analysis.statistics import Estimate
from uav_collect.studies.claims.claims import CLAIMS, JudgedClaim
from uav_collect.studies.claims.judging import ClaimStatus, combined_status, Evidence
from uav_collect.studies.jobs.costs import SpentCost
from uav_collect.studies.results_text import results_text
from uav_collect.studies.scale import load_scale


def measured(what: str, status: ClaimStatus, margin_percent: float, unit: str = 's') -> Evidence:
    estimate = Estimate(mean=1.0, low=0.5, high=1.5, median=1.0)
    return Evidence(
        what=what, unit=unit, n_missions=3, n_trainings=6, estimate=estimate,
        margin_percent=margin_percent, status=status, n_least=6, errors_beside=9.0,
    )  # fmt: skip


def document(*evidence: Sequence[Evidence]) -> list[str]:
    judged = [
        JudgedClaim(claim=claim, evidence=tuple(row), status=combined_status(row))
        for claim, row in zip(CLAIMS, evidence, strict=False)
    ]
    return results_text(load_scale('smoke'), {}, judged, SpentCost(), ()).splitlines()


def test_of_many_numbers_those_are_shown_first_that_decide() -> None:
    unsure = [measured(f'unsure {n}', ClaimStatus.OPEN, n) for n in (1, 2, 3)]
    beside = measured('beside it', ClaimStatus.FAILS, -8.0)
    row = next(line for line in document([*unsure, beside]) if line.startswith('| 1 |'))
    shown = row.split('<br>')
    assert [it.partition(':')[0] for it in shown[1:]] == ['beside it', 'unsure 1', 'unsure 2']
    assert row.endswith('| does not hold; -8.0 % |')


def test_statements_are_counted_in_a_sentence() -> None:
    statuses = ClaimStatus.HOLDS, ClaimStatus.HOLDS, ClaimStatus.FAILS
    rows = ([measured('it', status, 1.0)] for status in statuses)
    assert 'Of 3 statements 2 hold, 1 does not hold.' in document(*rows)


def test_what_has_no_unit_is_shown_without_one() -> None:
    text = '\n'.join(document([measured('correlation', ClaimStatus.HOLDS, 1.0, unit='1')]))
    assert 'correlation: 1 (0.5 to 1.5), n = 3 missions, 6 trainings' in text
    assert '| correlation | 1 | 0.5 to 1.5 |  | 3 missions, 6 trainings |' in text
