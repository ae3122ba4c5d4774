"""The command refine, on a tiny field, in this process."""

from collections.abc import Callable
import os
from pathlib import Path
import signal

import pytest
from random_policies import header, random_policy, saved
from tiny_world import tiny
from uav_collect.__main__ import main
from uav_collect.analysis.against_rules import Flown
from uav_collect.limits import FAILED, INTERRUPTED, UNUSABLE
from uav_collect.scenario.load import fingerprint
from uav_collect.training.config import load_preset
from uav_collect.uav.observation import Layout
from uav_collect.uav.policy import policy_for
from uav_collect.uav.policy_file import load_policy, save_policy

pytest.importorskip('torch', reason='training needs torch')
from trainer_states import poisoned
from uav_collect.commands import refine_session

SCENARIO = tiny(name='field')
QUICK = (
    *('--override', 'mixer.embedding_size=4', 'mixer.hypernetwork_size=4'),
    *('rollout.missions_at_once=4', 'rollout.decisions_per_update=40', 'replay.decisions=2000'),
    *('replay.missions_per_batch=4', 'validation.missions=2', 'validation.every_updates=3'),
)
Refine = Callable[..., int]


@pytest.fixture
def field(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The file of a field, flown a few times only."""
    monkeypatch.setattr(refine_session, '_N_CHOOSING', 4)
    monkeypatch.setattr(refine_session, '_N_JUDGING', 6)
    path = tmp_path / 'field.yaml'
    path.write_text(SCENARIO.to_yaml())
    return path


@pytest.fixture
def ever_better(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let whatever flies be better than all that flew before."""
    seen: list[Flown] = []

    def rank(flown: Flown) -> tuple[float, float]:
        if flown not in seen:
            seen.append(flown)
        return float(seen.index(flown)), 0.0

    monkeypatch.setattr(Flown, 'rank', property(rank))


@pytest.fixture
def start(tmp_path: Path) -> Path:
    """A policy that learned nothing, of another area."""
    return saved(tmp_path, 'start', header(side=10, n_uavs=2, hidden_size=8))


@pytest.fixture
def refined(field: Path, start: Path) -> Refine:
    """Refines from the start, and returns the exit status."""

    def run(*others: str, decisions: int = 400) -> int:
        words = ['refine', '--scenario', str(field), '--start-from', str(start)]
        return main([*words, '--decisions', str(decisions), *others, *QUICK])

    return run


@pytest.mark.usefixtures('ever_better')
def test_what_flies_better_than_the_start_is_kept_beside_the_scenario(
    refined: Refine, field: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert refined() == 0

    said, file = capsys.readouterr().out.splitlines(), field.with_suffix('.safetensors')
    kept = load_policy(file).header
    assert (kept.fingerprint, kept.preset, kept.hidden_size) == (
        *(fingerprint(SCENARIO), 'field'),
        8,
    )
    assert policy_for(str(file), SCENARIO).name == 'field'
    assert said[0].startswith('field, 2 UAVs: sweep ')
    assert said[1].startswith('from ') and 'start.safetensors: ' in said[1]
    assert said[-1].startswith(f'policy: {file}: ') and ' beside ' in said[-1]


@pytest.mark.usefixtures('ever_better')
def test_the_same_seed_refines_to_the_same_policy(
    refined: Refine, field: Path, tmp_path: Path
) -> None:
    assert refined() == 0
    assert refined('--output', str(tmp_path / 'again.safetensors')) == 0

    digests = {
        load_policy(path).digest
        for path in (field.with_suffix('.safetensors'), tmp_path / 'again.safetensors')
    }
    assert len(digests) == 1


def test_where_nothing_better_comes_no_file_is_written(
    refined: Refine, field: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert refined(decisions=1) == 0
    assert not field.with_suffix('.safetensors').exists()
    assert 'start.safetensors came: no file is written' in capsys.readouterr().out


def test_a_better_policy_that_is_there_stays(
    refined: Refine, field: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = saved(field.parent, 'field', header(side=4, n_uavs=2, hidden_size=8), seed=1)
    before = file.read_bytes()
    monkeypatch.setattr(Flown, 'rank', property(lambda flown: (1.0, 1.0)))

    assert refined() == 0
    assert file.read_bytes() == before


def test_it_goes_on_from_what_was_refined_before(
    field: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    saved(field.parent, 'field', header(side=4, n_uavs=2, hidden_size=8))
    monkeypatch.setattr(refine_session, 'shipped_policies', lambda: ())

    assert main(['refine', '--scenario', str(field), '--decisions', '1', *QUICK]) == 0
    assert f'from {field.with_suffix(".safetensors")}: ' in capsys.readouterr().out


@pytest.mark.usefixtures('ever_better')
def test_from_nothing_it_learns_with_the_advice_of_the_sweep(
    field: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(refine_session, 'shipped_policies', lambda: ())

    assert main(['refine', '--scenario', str(field), '--decisions', '400', *QUICK]) == 0
    assert '\nfrom nothing: ' in capsys.readouterr().out
    kept = load_policy(field.with_suffix('.safetensors')).header
    assert (kept.layout, kept.preset) == (Layout.RELATIVE, 'field_anywhere')
    assert kept.algorithm == 'branches'
    bonuses = [load_preset(kept.preset).advice_bonus(share) for share in (0.0, 0.15, 0.3)]
    assert bonuses == pytest.approx([0.1, 0.05, 0.0])


@pytest.mark.usefixtures('ever_better')
def test_an_interruption_keeps_what_came(
    refined: Refine, field: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def save_and_interrupt(*arguments: object) -> None:
        save_policy(*arguments)  # type: ignore[arg-type]
        os.kill(os.getpid(), signal.SIGINT)

    monkeypatch.setattr(refine_session, 'save_policy', save_and_interrupt)

    assert refined(decisions=1_000_000) == INTERRUPTED
    load_policy(field.with_suffix('.safetensors'))


@pytest.mark.usefixtures('ever_better')
def test_weights_that_are_no_numbers_end_it_and_keep_what_came(
    refined: Refine,
    field: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    poisoned(monkeypatch, 4)

    assert refined() == FAILED
    assert 'the training diverged' in capsys.readouterr().err
    load_policy(field.with_suffix('.safetensors'))


def test_a_shipped_scenario_needs_an_output(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(['refine', '--scenario', 'paper_8x8']) == UNUSABLE
    assert '--output: must be given, as paper_8x8' in capsys.readouterr().err


@pytest.mark.parametrize(
    ('name', 'problem'),
    [('policy.bin', 'must end in .safetensors'), ('sweep.safetensors', 'must not be called as')],
)
def test_an_output_that_no_policy_can_have_is_refused(
    name: str, problem: str, refined: Refine, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert refined('--output', str(tmp_path / name)) == UNUSABLE
    assert problem in capsys.readouterr().err


def test_a_file_of_another_network_is_not_written_over(
    refined: Refine, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / 'other.safetensors'
    save_policy(path, random_policy(header(Layout.PAPER, side=4)))

    assert refined('--output', str(path)) == UNUSABLE
    assert f'{path}: is of another network' in capsys.readouterr().err


def test_a_start_of_another_network_is_refused(
    field: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / 'other.safetensors'
    save_policy(path, random_policy(header(Layout.PAPER, side=4)))

    assert main(['refine', '--scenario', str(field), '--start-from', str(path)]) == UNUSABLE
    assert 'its observation, paper/1 of' in capsys.readouterr().err
