"""What a job goes on from is what was saved of it, or nothing goes on; what ends one is said."""

from dataclasses import replace
import json
from pathlib import Path
import pickle

from checkpoints import forged, Trap
from episodes import small
import numpy as np
import pytest
from study_jobs import FLEET, training
from tiny_world import tiny
from uav_collect.errors import CheckpointError, TrainingRunError
from uav_collect.learning.checkpoint import checkpoint_bytes
from uav_collect.studies.findings import Findings
from uav_collect.studies.jobs.jobs import CURVE, digest_of, POLICY, SUMMARY, training_job
from uav_collect.studies.jobs.store import Store
from uav_collect.studies.jobs.work import run_job
from uav_collect.studies.jobs.worker_messages import Finished, Saved, WorkItem
from uav_collect.studies.study import REWARD, TrainedPolicies
from uav_collect.training.progress import SpeedMeter
from uav_collect.uav.policy_file import policy_from_bytes

pytest.importorskip('torch', reason='training needs torch')
from trainer_states import poisoned


def saved_by(state: bytes | None) -> bytes:
    """What the first step of a job saves that goes on from a state."""
    job = training(decisions=100_000)
    work = WorkItem(digest=digest_of(job), job=job, inputs={}, state=state, checkpoint_s=0.0)
    return next(event.state for event in run_job(work) if isinstance(event, Saved))


def test_a_state_that_was_changed_or_runs_code_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    whole = saved_by(None)
    assert saved_by(whole)
    for state, words in (
        (pickle.dumps((Trap(), Trap())), 'is damaged: '),
        (whole[:-1], 'is damaged: '),
        (whole[:200] + b'x' + whole[201:], 'checksum mismatch'),
        (checkpoint_bytes({'job': {}}), 'cost is missing'),
        (forged(whole.replace(b'"n_interruptions":0', b'"n_interruptions":-')), 'is not JSON'),
        (forged(whole.replace(b'"cpu_s":', b'"cpu_x":')), 'cost/cpu_s is missing'),
        (forged(whole.replace(b'"seed":0', b'"seed":9')), 'seed is 9: must be 0'),
    ):
        with pytest.raises(CheckpointError, match=words):
            saved_by(state)
    assert not (tmp_path / 'trapped').exists()


def test_a_training_that_ends_before_its_first_update_says_what_that_takes() -> None:
    job = training(decisions=1)
    work = WorkItem(digest=digest_of(job), job=job, inputs={}, state=None, checkpoint_s=60.0)
    words = r'^aqmix, seed 0: nothing was learned: .* too few for an update: it takes '
    with pytest.raises(TrainingRunError, match=words):
        list(run_job(work))


@pytest.mark.parametrize('is_looked_at', [True, False])
def test_a_training_that_diverges_keeps_states_that_can_be_read_and_achieved_nothing(
    is_looked_at: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(SpeedMeter, 'is_due', lambda meter: is_looked_at)
    poisoned(monkeypatch, after=6)  # validated after 4 and 8
    job = training(decisions=1000)
    work = WorkItem(digest=digest_of(job), job=job, inputs={}, state=None, checkpoint_s=0.0)
    *_, saved, done = (it for it in run_job(work) if isinstance(it, Saved | Finished))
    assert isinstance(saved, Saved)
    assert isinstance(done, Finished)
    *_, again = run_job(replace(work, state=saved.state))
    assert isinstance(again, Finished)
    assert again.results == done.results
    summary = json.loads(done.results[SUMMARY])
    assert summary['diverged'] == 'after 7 updates: the loss is nan'
    assert summary['best']['version'].partition('@')[2].startswith('4-')
    store = Store(tmp_path)
    store.save(job, done.results, done.cost)
    trained = TrainedPolicies(label='AQMIX', algorithm='aqmix', digests=(work.digest,))
    assert np.isnan(Findings(store).final_values(trained, REWARD.key)).all()


def learned_by(algorithm: str) -> tuple[bytes, str]:
    """What a training of a single UAV gives: its curve, and the digest of its policy's weights."""
    job = training_job(tiny(FLEET[0]), small('strong'), algorithm, 0, 1000)
    work = WorkItem(digest=digest_of(job), job=job, inputs={}, state=None, checkpoint_s=60.0)
    results = next(event.results for event in run_job(work) if isinstance(event, Finished))
    return results[CURVE], policy_from_bytes(results[POLICY]).digest


def test_a_single_uav_learns_by_qmix_what_it_learns_by_aqmix() -> None:
    by_aqmix = learned_by('aqmix')
    assert learned_by('qmix') == by_aqmix
    assert learned_by('aiql') != by_aqmix
