"""Policies: files whose head, texts, tensors or bytes were changed, and functions of users.

A file is read as what it says, to the last weight, or refused in a line that says what is wrong of
it; of today's format no byte changes unnoticed. A function's answer is a legal action, or the
mission ends with a line about it.
"""

from collections.abc import Callable, Mapping
from dataclasses import fields
import functools
import json
from pathlib import Path
import re
import tempfile
from typing import Any, NoReturn

from fuzzing import check_lines, check_outcome, fuzzed, memory_folder, run_command
from hypothesis import strategies as st
import numpy as np
from policy_changes import (
    ADVISED,
    Change,
    CHANGES,
    DOMAINS,
    forged,
    head_and_data,
    JOINT,
    NUMBERS,
    SCENARIO,
    set_json,
    WHOLE,
    WHOLE_NUMBERS,
    WORDS,
)
from tiny_world import tiny
from uav_collect.errors import PolicyMismatchError
from uav_collect.kernels.arrays import new_row, row_of
from uav_collect.uav.action_codes import HOME, NONE
from uav_collect.uav.belief import belief_of, new_beliefs
from uav_collect.uav.briefing import brief
from uav_collect.uav.observation import Layout, observation_size
from uav_collect.uav.policy import unfamiliar
from uav_collect.uav.policy_file import (
    policy_bytes,
    policy_from_bytes,
)
from uav_collect.uav.policy_network import FrozenPolicy, LearnedPolicy
from uav_collect.uav.user_policy import policy_of
from uav_collect.uav.view import LocalView

BRIEFING = brief(SCENARIO)
NO_SENSOR, NOTHING = new_row(0, 0), new_row(0, 0.0)
VIEW = LocalView(
    time_s=0.0, x_m=25.0, y_m=25.0, cell=0, energy_left_j=1e6, previous_action=NONE,
    region_bit=new_row(9, 0.0), n_sensors=0, sensor=NO_SENSOR, sensor_bit=NOTHING,
    sensor_gain=NOTHING, sensor_error_gain=NOTHING,
)  # fmt: skip
LEGAL = row_of([1, 1, 1, 0, 0])
FIELD = tiny(fleet__default__energy_budget_kj=5.0, name='field').to_yaml()
# What files of before do not say.
SAID_SINCE = {'learned_on', 'learned_within', 'advice_bonus', 'network', 'code', 'domains'}
REASONS = (': must be ', ' is missing', ' is unknown', 'is not a whole safetensors file (')


@fuzzed(share=0.42, changes=CHANGES)
def test_a_forged_file_is_read_as_what_it_says_or_refused(changes: list[Change]) -> None:
    check_forged(forged(changes))


@fuzzed(share=0.1, domains=DOMAINS)
def test_domains_that_were_forged_are_spans_or_refused(domains: object) -> None:
    for whole in (ADVISED, JOINT):
        check_forged(forged([functools.partial(set_json, 'domains', domains)], whole))


@fuzzed(
    share=0.25,
    place=st.floats(0, 1, exclude_max=True),
    new=st.one_of(st.binary(min_size=1, max_size=4), st.integers(0, 7).map(lambda n: 1 << n)),
)
def test_bytes_that_change_anywhere_in_a_file_are_noticed(place: float, new: bytes | int) -> None:
    at = int(place * len(WHOLE))
    changed = bytes([WHOLE[at] ^ new]) if isinstance(new, int) else new
    content = WHOLE[:at] + changed + WHOLE[at + len(changed) :]
    if content != WHOLE:
        check_refused(content)


@fuzzed(
    share=0.1,
    start=st.integers(0, len(WHOLE)),
    end=st.integers(0, len(WHOLE)),
    more=st.binary(max_size=20),
)
def test_a_file_that_lacks_a_part_or_has_more_is_refused(
    start: int, end: int, more: bytes
) -> None:
    content = WHOLE[:start] + more + WHOLE[end:]
    if content != WHOLE:
        check_refused(content)


@fuzzed(share=0.03, changes=CHANGES)
def test_a_command_flies_a_forged_file_or_refuses_it_by_its_name(changes: list[Change]) -> None:
    with tempfile.TemporaryDirectory(dir=memory_folder('policy')) as name:
        folder = Path(name)
        (folder / 'forged.safetensors').write_bytes(forged(changes))
        (folder / 'field.yaml').write_text(FIELD)
        outcome = run_command(
            'evaluate', '--scenario', folder / 'field.yaml', '--missions', 1,
            '--policy', folder / 'forged.safetensors',
        )  # fmt: skip
        check_outcome(outcome, names='forged')


def check_forged(content: bytes) -> None:
    """Hold a file whose digest is right to be read as what it says, or refused."""
    try:
        policy = policy_from_bytes(content)
    except PolicyMismatchError as error:
        check_refusal(error)
        return
    check_meaning(policy, content)


def check_refused(content: bytes) -> None:
    """Hold a file to be refused."""
    try:
        policy_from_bytes(content)
    except PolicyMismatchError as error:
        check_refusal(error)
    else:
        raise AssertionError(content)


def check_refusal(error: PolicyMismatchError) -> None:
    """Hold a refusal to a line that says what is wrong."""
    check_lines([str(error)])
    assert any(reason in str(error) for reason in REASONS), error


def check_meaning(policy: FrozenPolicy, content: bytes) -> None:
    """Hold a policy to what its file says, and to be of use."""
    head, data = head_and_data(content)
    texts = head.pop('__metadata__')
    for field in fields(policy.header):
        value = getattr(policy.header, field.name)
        if field.name not in texts:
            assert field.name in SAID_SINCE, texts
            assert value == field.default
        elif isinstance(value, str):
            assert value == texts[field.name]
        elif isinstance(value, Layout):
            assert value.label == texts[field.name]
        elif isinstance(value, int):
            assert value == int(texts[field.name])
        else:
            check_record(value, json.loads(texts[field.name]))
    of = policy.header
    for side, n_uavs in (
        (of.cells_per_side_min, of.n_uavs_min),
        (of.cells_per_side_max, of.n_uavs_max),
    ):
        assert 1 <= side <= 64
        assert 1 <= n_uavs <= 64
        assert observation_size(of.layout, side * side, n_uavs) == of.observation_size
    by_place = sorted(head, key=lambda name: head[name]['data_offsets'])
    weights = b''.join(policy.weights[name].tobytes() for name in by_place)
    assert weights == data
    again = policy_from_bytes(policy_bytes(policy))
    assert again.header == policy.header
    assert again.digest == policy.digest
    check_use(policy)


def check_record(value: Any, said: Any) -> None:  # noqa: ANN401 - a record, or a part of one
    """Hold a record to the JSON that it was read from."""
    if isinstance(value, tuple):
        assert len(value) == len(said)
        for each, of in zip(value, said, strict=True):
            check_record(each, of)
    elif isinstance(said, dict):
        for name, of in said.items():
            check_record(getattr(value, name), of)
    else:
        assert value == (float(said) if isinstance(value, float) else said)  # as 10^30 is rounded
        assert isinstance(said, bool) == isinstance(value, bool)


def check_use(policy: FrozenPolicy) -> None:
    """Hold a policy to values that are numbers, differences that can be told, legal actions."""
    observed = np.ones((1, policy.header.observation_size))
    for network in policy.networks:
        values, hidden = network.step(observed, network.new_hidden(1))
        assert np.isfinite(values).all()
        assert np.isfinite(hidden).all()
    flown = LearnedPolicy('forged', policy)
    line = unfamiliar(flown, SCENARIO) or ''
    assert line.isprintable()
    assert 'nan' not in line
    if policy.header.misfit(BRIEFING) is None:
        flown.begin(BRIEFING, 0)
        action = flown.choose(belief_of(new_beliefs(BRIEFING, 1), 0), VIEW, LEGAL)
        assert action == HOME or LEGAL[action] == 1


# Functions of users.


class _Raises:
    """Raises whatever is done with it."""

    def __init__(self, error: BaseException) -> None:
        self._error = error

    def _fail(self, *_: object) -> NoReturn:
        raise self._error

    __call__ = __index__ = __repr__ = __str__ = __eq__ = __lt__ = __len__ = __iter__ = _fail
    __hash__ = None  # type: ignore[assignment]


ERRORS = st.builds(
    lambda kind, arguments: kind(*arguments),
    st.sampled_from(
        [
            SystemExit, KeyboardInterrupt, GeneratorExit, Exception, ValueError, KeyError, OSError,
            StopIteration, RecursionError, MemoryError, AssertionError, Warning, ArithmeticError,
        ]
    ),
    st.lists(st.one_of(WORDS, WHOLE_NUMBERS), max_size=2),
)  # fmt: skip
ANSWERS: st.SearchStrategy[Any] = st.one_of(
    WHOLE_NUMBERS,
    NUMBERS,
    WORDS,
    st.none(),
    st.booleans(),
    st.binary(max_size=5),
    st.complex_numbers(),
    st.integers(0, 6).map(np.int8),
    st.integers(0, 6).map(np.uint64),
    st.integers(0, 6).map(np.array),
    st.integers(0, 6).map(lambda number: np.array([number])),
    st.floats(0, 6).map(np.float32),
    st.builds(lambda: np.True_),
    st.builds(object),
    st.builds(lambda: (each for each in (1,))),
)
WAYS: Mapping[str, Callable[[Any, BaseException], Any]] = {
    'returns': lambda answer, _: answer,
    'raises': lambda _, error: _Raises(error)(),
    'returns what raises': lambda _, error: _Raises(error),
    'returns a list of it': lambda _, error: [_Raises(error)],
    'raises what raises': lambda _, error: _Raises(ValueError(_Raises(error)))(),
}


@fuzzed(share=0.1, way=st.sampled_from(sorted(WAYS)), answer=ANSWERS, error=ERRORS)
def test_a_function_of_a_user_takes_a_legal_action_or_costs_a_line(
    way: str,
    answer: Any,  # noqa: ANN401
    error: BaseException,
) -> None:
    def decide(situation: object) -> object:
        return WAYS[way](answer, error)

    policy = policy_of(decide)
    policy.begin(BRIEFING, 0)
    try:
        action = policy.choose(belief_of(new_beliefs(BRIEFING, 1), 0), VIEW, LEGAL)
    except PolicyMismatchError as refusal:
        check_lines([str(refusal)], names='policy decide: UAV 1 at 0.0 s in cell 0: ')
        assert re.search(r'[(]test_policy.py, line [0-9]+[)]$', str(refusal))
        return
    assert way == 'returns'
    assert type(action) is int
    assert action == HOME or LEGAL[action] == 1
    assert action == int(answer)
