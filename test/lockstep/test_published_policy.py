"""Which of the policies that trainers publish count, and how a UAV takes one up."""

import hashlib
from pathlib import Path
import sys
from types import SimpleNamespace
from typing import Any

from policy_publisher import HOVER_SHARE, policy_fields
import pytest
from random_policies import header, random_policy
from uav_collect.kernels.arrays import row_of
from uav_collect.lockstep.published_policy import PolicyStore, TopicPolicy
from uav_collect.scenario.load import load
from uav_collect.uav.action_codes import NONE
from uav_collect.uav.briefing import brief, Briefing
from uav_collect.uav.exploration import explore
from uav_collect.uav.named_code import TRUSTED_VARIABLE
from uav_collect.uav.policy_file import policy_bytes
from uav_collect.uav.policy_network import ExploringPolicy, LearnedPolicy

FROZEN = random_policy(header())


@pytest.fixture(scope='module')
def briefing() -> Briefing:
    return brief(load('paper_10x10'))


def message(sequence: int, trainer: str = 'one', sec: int = 0, **values: object) -> Any:  # noqa: ANN401
    """A Policy message as far as a store reads it."""
    about = {'trainer_instance': trainer, 'stamp': SimpleNamespace(sec=sec, nanosec=0), **values}
    return SimpleNamespace(**policy_fields(FROZEN, sequence, 0.25) | about)


def latest(store: PolicyStore) -> tuple[str, int]:
    assert store.latest is not None
    return store.latest.key


def test_of_one_trainer_the_highest_sequence_counts_however_they_arrive(
    briefing: Briefing,
) -> None:
    store = PolicyStore(briefing)
    for sequence in (2, 3, 1, 3):
        assert store.add(message(sequence)) is None
    assert latest(store) == ('one', 3)


def test_of_two_trainers_the_later_stamp_counts(briefing: Briefing) -> None:
    store = PolicyStore(briefing)
    store.add(message(7, 'one', sec=100))
    store.add(message(1, 'two', sec=200))
    store.add(message(8, 'one', sec=150))
    assert latest(store) == ('two', 1)


def test_once_its_trainer_is_gone_the_next_one_counts_whatever_its_clock_says(
    briefing: Briefing,
) -> None:
    store = PolicyStore(briefing)
    store.add(message(7, 'one', sec=100))
    store.mark_trainer_gone()
    assert latest(store) == ('one', 7)
    store.add(message(1, 'two', sec=50))
    assert latest(store) == ('two', 1)
    store.add(message(1, 'three', sec=40))
    assert latest(store) == ('two', 1)


def test_a_store_keeps_the_last_few(briefing: Briefing) -> None:
    store = PolicyStore(briefing)
    for sequence in range(1, 11):
        store.add(message(sequence))
    kept = [sequence for sequence in range(1, 11) if store.get(('one', sequence))]
    assert kept == [7, 8, 9, 10]


def test_what_is_refused_leaves_the_store_as_it_was(briefing: Briefing) -> None:
    store = PolicyStore(briefing)
    store.add(message(1))
    refusal = store.add(message(2, sha256='0' * 64))
    assert refusal is not None
    assert refusal.startswith(f"policy '{FROZEN.header.version}' of the trainer is refused: ")
    assert latest(store) == ('one', 1)
    assert store.add(message(2)) is None


def test_what_was_heard_is_judged_anew_for_another_fleet(briefing: Briefing) -> None:
    other = brief(load('paper_8x8'))
    store = PolicyStore(other)
    (refusal,) = {store.add(message(1)), store.add(message(2))}
    assert store.recheck(briefing) == []
    assert latest(store) == ('one', 2)
    assert store.recheck(other) == [refusal] * 2
    assert (store.latest, store.get(('one', 2))) == (None, None)


@pytest.mark.parametrize('n_after', [0, 1])
def test_another_fleet_brings_no_trainer_back_that_is_gone(
    n_after: int, briefing: Briefing
) -> None:
    store = PolicyStore(briefing)
    store.add(message(7, 'one', sec=100))
    store.mark_trainer_gone()
    for sequence in range(1, 2 + n_after):
        if sequence > 1 - n_after:
            store.add(message(sequence, 'two', sec=50))
    store.recheck(briefing)
    store.add(message(3, 'two', sec=50))
    assert latest(store) == ('two', 3)


@pytest.mark.parametrize(
    ('values', 'complaint'),
    [
        ({'epsilon': -0.1}, 'epsilon is -0.1'),
        ({'epsilon': 1.1}, 'epsilon is 1.1'),
        ({'hover_share': 1.5}, 'hover_share is 1.5'),
        ({'hover_share': float('-inf')}, 'hover_share is -inf'),
        ({'advice_share': 1.5}, 'advice_share is 1.5'),
        ({'advice_share': float('nan')}, 'advice_share is nan'),
        ({'content': b''}, 'SHA-256'),
    ],
)
def test_values_out_of_range_are_named(
    values: dict[str, object], complaint: str, briefing: Briefing
) -> None:
    assert complaint in (PolicyStore(briefing).add(message(1, **values)) or '')


def observation(decision: int, sequence: int = 1, key: int = 5) -> Any:  # noqa: ANN401
    return SimpleNamespace(
        decision=decision, policy_trainer='one', policy_sequence=sequence, exploration_key=key
    )


def test_a_mission_waits_for_the_policy_that_its_first_observation_names(
    briefing: Briefing,
) -> None:
    store = PolicyStore(briefing)
    topic_policy = TopicPolicy(store)
    topic_policy.begin(briefing, 0)
    store.add(message(1))
    assert not topic_policy.is_ready_for(observation(0, sequence=2))
    store.add(message(2))
    assert topic_policy.is_ready_for(observation(0, sequence=2))
    topic_policy.select(observation(0, sequence=1))
    assert topic_policy.current is not None
    assert topic_policy.version == f'{FROZEN.header.version} eps 0.25'
    assert topic_policy.is_ready_for(observation(3, sequence=9))  # what it flies stays


def test_exploration_follows_the_mission_seed_the_uav_and_its_decisions(
    briefing: Briefing, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(LearnedPolicy, 'choose', lambda *_: 4)
    policy = ExploringPolicy(LearnedPolicy('mine', FROZEN), 0.5, HOVER_SHARE, mission_seed=5)
    legal = row_of([1, 1, 0, 1, 1])
    for _ in range(2):
        policy.begin(briefing, 1)
        chosen = [policy.choose(None, None, legal) for _ in range(50)]  # type: ignore[arg-type]
        random = [explore(5, 1, it, 0.5, HOVER_SHARE, 0.0, NONE, legal) for it in range(50)]
        assert chosen == [4 if action < 0 else action for action in random]
    assert len(set(chosen)) > 2


def test_code_that_a_published_policy_names_is_imported_only_if_it_is_trusted(
    briefing: Briefing, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (tmp_path / 'by_topic.py').write_text('raise RuntimeError("was imported")\n')
    monkeypatch.syspath_prepend(tmp_path)
    # The digest covers what is written; only the label of the layout names the module.
    plain = policy_bytes(FROZEN)
    label = FROZEN.header.layout.label.encode()
    named = b'by_topic:Sees'.ljust(len(label))[: len(label)]
    assert label in plain and named.decode().partition(':')[0] == 'by_topic'
    content = plain.replace(label, named)
    values = {'content': content, 'sha256': hashlib.sha256(content).hexdigest()}

    refusal = PolicyStore(briefing).add(message(1, **values))
    assert refusal is not None and f'only imported where {TRUSTED_VARIABLE} lists it' in refusal
    assert 'was imported' not in refusal
    assert 'by_topic' not in sys.modules

    monkeypatch.setenv(TRUSTED_VARIABLE, f'other:Thing,{named.decode()}')
    refusal = PolicyStore(briefing).add(message(1, **values))
    assert refusal is not None and 'was imported' in refusal
