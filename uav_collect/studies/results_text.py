"""Writes what was found as a document: every claim with its evidence, and what it took."""

from collections import Counter
from collections.abc import Mapping, Sequence

from uav_collect.analysis.statistics import CONFIDENCE_LEVEL
from uav_collect.studies.claims.claims import JudgedClaim
from uav_collect.studies.claims.judging import ClaimStatus, Evidence, MIN_SEEDS
from uav_collect.studies.jobs.costs import SpentCost
from uav_collect.studies.scale import ScaleConfig
from uav_collect.studies.study import Study

_ORDER = (ClaimStatus.HOLDS, ClaimStatus.FAILS, ClaimStatus.OPEN, ClaimStatus.NOT_RUN)
_FEW = 3  # pieces of evidence that the first table has room for


def results_text(
    scale: ScaleConfig,
    studies: Mapping[str, Study],
    judged: Sequence[JudgedClaim],
    spent: SpentCost,
    not_run: Sequence[str],
) -> str:
    """The document, in Markdown.

    Args:
        spent: what the jobs of the studies took.
        not_run: studies that were not asked for, or lack a job.
    """
    parts = [
        "# Results of the paper's studies",
        'The paper that this program follows says how well its fleets do. Here each of its '
        'statements is held against missions that this program flew: what was measured, with its '
        'interval, and whether the statement holds.',
        f'Made by `python -m uav_collect figures --scale {scale.name}`; not edited by hand.',
        _what_was_run(scale, studies, spent, not_run),
        '## Claims',
        f'A statement of the paper, in our words, holds if the {CONFIDENCE_LEVEL:.0%} bootstrap '
        'interval of every number that it takes lies where the statement puts it, and does not if '
        'one lies elsewhere as a whole. Tests are paired by mission, all with the optimal '
        'bandwidth and with the best policy of all seeds in validation; what is said of learning '
        f'is paired by seed, in the last fifth of trainings, and takes {MIN_SEEDS} seeds.',
        _counts(judged),
        _table(judged),
        '## Evidence',
        *(_details(number, it) for number, it in enumerate(judged, start=1) if it.evidence),
    ]
    return '\n\n'.join(parts) + '\n'


def _what_was_run(
    scale: ScaleConfig, studies: Mapping[str, Study], spent: SpentCost, not_run: Sequence[str]
) -> str:
    tests = scale.tests
    last = tests.first_seed + tests.missions - 1
    seeds = ', '.join(f'{name} {n}' for name, n in scale.seeds.as_mapping().items())
    fleets = ', '.join(f'{it.n_uavs} UAVs {it.decisions:,}' for it in scale.fleets)
    decisions = ', '.join(
        f'{name} ({field["scenario"]}) {field["decisions"]:,}'
        for name, field in scale.fields.as_mapping().items()
    )
    lines = [
        f'- Scale `{scale.name}`: preset `{scale.trainings.preset}`'
        f'{_overrides(scale.trainings.set)}.',
        f'- Decisions of a training: {decisions}; by fleet on the usual field: {fleets}.',
        f'- Trainings of each algorithm, seeds from 0: {seeds}.',
        f'- Test missions: {tests.missions}, seeds {tests.first_seed} to {last}.',
        f'- Done: {spent.text()}.',
        f'- Studies: {", ".join(studies)}.',
    ]
    if not_run:
        lines.append(f'- Not run: {", ".join(not_run)}.')
    return '\n'.join(lines)


def _overrides(values: Mapping[str, object]) -> str:
    text = ', '.join(f'`{key}={value}`' for key, value in values.items())
    return f' with {text}' if text else ''


def _counts(judged: Sequence[JudgedClaim]) -> str:
    counted = Counter(it.status for it in judged)
    counts = [f'{counted[status]} {status}' for status in _ORDER if counted[status]]
    return f'Of {len(judged)} statements: {", ".join(counts)}.'


def _table(judged: Sequence[JudgedClaim]) -> str:
    lines = ['| | fig. | statement | measured | verdict |', '|---|---|---|---|---|']
    for number, it in enumerate(judged, start=1):
        claim = it.claim
        lines.append(
            f'| {number} | {claim.figure} | {claim.statement} | {_measured(it.evidence)} '
            f'| {it.status} |'
        )
    return '\n'.join(lines)


def _measured(evidence: Sequence[Evidence]) -> str:
    """All numbers where they are few; else how many say what, and those that decide."""
    if len(evidence) <= _FEW:
        return '<br>'.join(map(_shown, evidence))
    counted = Counter(it.status for it in evidence)
    counts = [f'{counted[status]} of {len(evidence)} {_word(status)}' for status in counted]
    against = [it for it in evidence if it.status is not ClaimStatus.HOLDS][:_FEW]
    return '<br>'.join([', '.join(counts), *map(_shown, against)])


def _word(status: ClaimStatus) -> str:
    return {
        ClaimStatus.HOLDS: 'hold',
        ClaimStatus.FAILS: 'do not hold',
        ClaimStatus.OPEN: 'are open',
    }[status]


def _details(number: int, judged: JudgedClaim) -> str:
    lines = [
        f'### {number}. {judged.claim.statement}',
        '',
        '| | mean | interval | unit | n | |',
        '|---|---|---|---|---|---|',
    ]
    for it in judged.evidence:
        mean, span = _numbers(it)
        count = f'{it.n} {it.noun}{"" if it.n == 1 else "s"}'
        lines.append(f'| {it.what} | {mean} | {span} | {it.unit} | {count} | {it.status} |')
    return '\n'.join(lines)


def _shown(evidence: Evidence) -> str:
    mean, span = _numbers(evidence)
    count = f'n = {evidence.n} {evidence.noun}{"" if evidence.n == 1 else "s"}'
    return f'{evidence.what}: {mean} ({span}) {evidence.unit}, {count}'


def _numbers(evidence: Evidence) -> tuple[str, str]:
    estimate = evidence.estimate
    if estimate is None:
        return '-', '-'
    return f'{estimate.mean:.4g}', f'{estimate.low:.4g} to {estimate.high:.4g}'
