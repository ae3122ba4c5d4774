"""Writes what was found as a document: every claim with its evidence, and what it took."""

from collections import Counter
from collections.abc import Mapping, Sequence

from uav_collect.analysis.statistics import CONFIDENCE_LEVEL
from uav_collect.studies.claims.claims import JudgedClaim
from uav_collect.studies.claims.judging import ClaimStatus, deciding, Evidence, MIN_TRAININGS
from uav_collect.studies.claims.words import READINGS
from uav_collect.studies.jobs.costs import SpentCost
from uav_collect.studies.scale import ScaleConfig
from uav_collect.studies.study import Study

_SURE_TRAININGS = 6  # agree by chance once in 32: enough to say no more about it
_PAPER = 'paper'  # the preset that trains as the paper does
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
        not_run: studies that lack a job.
    """
    parts = [
        "# Results of the paper's studies",
        'The paper that this program follows says how well its fleets do. Here each of its '
        'statements is held against missions that this program flew: what was measured, with its '
        'interval, and whether the statement holds.',
        f'Made by `python -m uav_collect figures --scale {scale.name}`; not edited by hand.',
        _what_was_run(scale, studies, spent, not_run),
        '## Claims',
        f'A statement of the paper, in our words, holds if the {CONFIDENCE_LEVEL:.0%} interval of '
        'every number that it takes lies where the statement puts it, and does not if one lies '
        'elsewhere as a whole. Trainings and missions are both drawn anew (a hierarchical '
        'bootstrap, its percentiles widened for few trainings), so no number depends on which '
        'training is the best; tests fly the same missions, with the optimal bandwidth. What is '
        'said of learning is measured in the last fifth of trainings. '
        f'Fewer than {MIN_TRAININGS} trainings decide nothing, and the interval of '
        f'{MIN_TRAININGS} hardly leaves their range, which holds the truth three times in four. '
        'Of many numbers one may miss by chance: a statement of many fails only by a miss that no '
        f'more than {1 - CONFIDENCE_LEVEL:.0%} of such statements would have (Bonferroni). Beside '
        'the verdict stands the margin of the number that decides: how far it is from where the '
        'statement turns, in per cent or percentage points; negative, how far beside it.',
        *_other_method(scale.trainings.preset),
        "How the paper's words are read:\n\n" + '\n'.join(f'- {it}' for it in READINGS),
        _counts(judged),
        _table(judged),
        '## Evidence',
        *(_details(number, it) for number, it in enumerate(judged, start=1) if it.evidence),
    ]
    return '\n\n'.join(parts) + '\n'


def _other_method(preset: str) -> Sequence[str]:
    if preset == _PAPER:
        return ()
    return (
        f'The preset `{preset}` does not train as the paper does: reward, observation, targets, '
        'networks and the choice of the best policy differ. What is said of AQMIX, QMIX and AIQL '
        'is said of them so trained, for as many decisions as stand above.',
    )


def _what_was_run(
    scale: ScaleConfig, studies: Mapping[str, Study], spent: SpentCost, not_run: Sequence[str]
) -> str:
    tests = scale.tests
    last = tests.first_seed + tests.missions - 1
    seeds = ', '.join(f'{name} {n}' for name, n in scale.seeds.as_mapping().items())
    fleets = ', '.join(
        f'{it.n_uavs} UAV{"" if it.n_uavs == 1 else "s"} {it.decisions:,}' for it in scale.fleets
    )
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
    counts = [
        f'{counted[status]} {_word(status, counted[status])}'
        for status in ClaimStatus
        if counted[status]
    ]
    return f'Of {len(judged)} statements {", ".join(counts)}.'


def _table(judged: Sequence[JudgedClaim]) -> str:
    lines = ['| | fig. | statement | measured | verdict |', '|---|---|---|---|---|']
    for number, it in enumerate(judged, start=1):
        claim = it.claim
        lines.append(
            f'| {number} | {claim.figure} | {claim.statement} | {_measured(it.evidence)} '
            f'| {_verdict(it)} |'
        )
    return '\n'.join(lines)


def _verdict(judged: JudgedClaim) -> str:
    """The status, how near it was, and what so few trainings resolve."""
    parts, decides = [str(judged.status)], deciding(judged.evidence)
    if decides is not None:
        parts.append(f'{decides.margin_percent:+.1f} %')
        n_trainings = min((it.n_trainings for it in judged.evidence if it.n_trainings), default=0)
        if MIN_TRAININGS <= n_trainings < _SURE_TRAININGS:
            chance = 2 ** (n_trainings - 1)
            parts.append(f'{n_trainings} trainings agree by chance once in {chance}')
        if judged.claim.note:
            parts.append(judged.claim.note)
    return '; '.join(parts)


def _measured(evidence: Sequence[Evidence]) -> str:
    """All numbers where they are few; else how many say what, and those that decide."""
    if len(evidence) <= _FEW:
        return '<br>'.join(map(_shown, evidence))
    counted = Counter(it.status for it in evidence)
    counts = [
        f'{counted[status]} of {len(evidence)} {_word(status, counted[status])}'
        for status in counted
    ]
    against = sorted(
        (it for it in evidence if it.status is not ClaimStatus.HOLDS),
        key=lambda it: (it.status is not ClaimStatus.FAILS, it.margin_percent),
    )
    return '<br>'.join([', '.join(counts), *map(_shown, against[:_FEW])])


def _word(status: ClaimStatus, number: int) -> str:
    """What so many statements or numbers do, for people."""
    one, several = {
        ClaimStatus.HOLDS: ('holds', 'hold'),
        ClaimStatus.TIE: ('is a tie', 'are ties'),
        ClaimStatus.FAILS: ('does not hold', 'do not hold'),
        ClaimStatus.OPEN: ('is not resolvable at this scale', 'are not resolvable at this scale'),
        ClaimStatus.SAME: ('is not judged', 'are not judged'),
        ClaimStatus.NOT_RUN: ('was not run', 'were not run'),
    }[status]
    return one if number == 1 else several


def _details(number: int, judged: JudgedClaim) -> str:
    lines = [
        f'### {number}. {judged.claim.statement}',
        '',
        '| | mean | interval | unit | n | margin | |',
        '|---|---|---|---|---|---|---|',
    ]
    for it in judged.evidence:
        mean, span = _numbers(it)
        margin = '-' if it.estimate is None else f'{it.margin_percent:+.1f} %'
        lines.append(
            f'| {it.what} | {mean} | {span} | {_unit(it)} | {it.count} | {margin} | {it.status} |'
        )
    return '\n'.join(lines)


def _shown(evidence: Evidence) -> str:
    mean, span = _numbers(evidence)
    measured = f'{evidence.what}: {mean} ({span}) {_unit(evidence)}'.rstrip()
    return f'{measured}, n = {evidence.count}'


def _unit(evidence: Evidence) -> str:
    return '' if evidence.unit == '1' else evidence.unit


def _numbers(evidence: Evidence) -> tuple[str, str]:
    estimate = evidence.estimate
    if estimate is None:
        return '-', '-'
    return f'{estimate.mean:.4g}', f'{estimate.low:.4g} to {estimate.high:.4g}'
