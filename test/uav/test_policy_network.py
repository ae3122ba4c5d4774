"""The frozen policy: its file, its numbers against torch, and what is refused."""

from collections.abc import Callable
from dataclasses import asdict, replace
from functools import partial
import hashlib
import json
import os
from pathlib import Path
import sys
import tracemalloc

import numpy as np
from processes import completed
import pytest
from random_policies import (
    header,
    of_before,
    random_policy,
    random_weights,
    saved,
    VALIDATION,
)
from safetensors import safe_open
from safetensors.numpy import save_file
from tiny_world import tiny
import torch
from uav_collect.__main__ import main
from uav_collect.errors import PolicyMismatchError
from uav_collect.kernels.arrays import Bools, Floats
from uav_collect.scenario.load import load
from uav_collect.uav.action_codes import N_ACTIONS
from uav_collect.uav.briefing import brief
from uav_collect.uav.learned_on import learned_on
from uav_collect.uav.observation import Layout
from uav_collect.uav.policy import frozen_policy, outdated, shipped_policies
from uav_collect.uav.policy_file import (
    FORMAT,
    load_policy,
    policy_bytes,
    policy_from_bytes,
    save_policy,
    WEIGHTS_FORMAT,
)
from uav_collect.uav.policy_network import best_actions, FrozenPolicy, weights_digest
from uav_collect.uav.tensor_file import read_head

N_SEQUENCES, N_STEPS = 10_000, 6


class Reference(torch.nn.Module):
    """The network as torch has it, from its own parts."""

    def __init__(self, policy: FrozenPolicy, dtype: torch.dtype) -> None:
        super().__init__()
        n_inputs, size = policy.header.observation_size, policy.header.hidden_size
        self.encoder = torch.nn.Linear(n_inputs, size)
        self.gru = torch.nn.GRUCell(size, size)
        self.head = torch.nn.Linear(size, N_ACTIONS)
        tensors = {name: torch.from_numpy(tensor) for name, tensor in policy.weights.items()}
        self.load_state_dict(tensors)
        self.to(dtype)

    def forward(self, observation: torch.Tensor, hidden: torch.Tensor) -> torch.Tensor:
        return self.gru(torch.relu(self.encoder(observation)), hidden)


def observations(n_rows: int, size: int, rng: np.random.Generator) -> Floats:
    """Rows like those of missions: most are zero, the others about one."""
    return rng.normal(size=(n_rows, size)) * (rng.random((n_rows, size)) < 0.3)


def legal_rows(n_rows: int, rng: np.random.Generator) -> Bools:
    legal = rng.random((n_rows, N_ACTIONS)) < 0.7
    legal[np.arange(n_rows), rng.integers(N_ACTIONS, size=n_rows)] = True
    return legal


@pytest.mark.parametrize(
    ('dtype', 'tolerance'), [(torch.float64, 1e-12), (torch.float32, 1e-6)], ids=str
)
def test_values_are_those_of_torch(dtype: torch.dtype, tolerance: float) -> None:
    of = header(hidden_size=64)
    policy = FrozenPolicy(of, random_weights(of))
    reference, rng = Reference(policy, dtype), np.random.default_rng(5)
    hidden, torch_hidden = policy.new_hidden(500), torch.zeros(500, 64, dtype=dtype)
    for _ in range(50):
        observed = observations(500, of.observation_size, rng)
        values, hidden = policy.step(observed, hidden)
        with torch.no_grad():
            torch_hidden = reference(torch.from_numpy(observed).to(dtype), torch_hidden)
            wanted = reference.head(torch_hidden).numpy()
        np.testing.assert_allclose(values, wanted, rtol=0.0, atol=tolerance)


def test_ten_thousand_sequences_are_answered_as_torch_would() -> None:
    of = header(hidden_size=64)
    policy, rng = random_policy(of), np.random.default_rng(6)
    reference = Reference(policy, torch.float64)
    hidden = policy.new_hidden(N_SEQUENCES)
    torch_hidden = torch.zeros(N_SEQUENCES, 64, dtype=torch.float64)
    answers = set()
    for _ in range(N_STEPS):
        observed, legal = (
            observations(N_SEQUENCES, of.observation_size, rng),
            legal_rows(N_SEQUENCES, rng),
        )
        values, hidden = policy.step(observed, hidden)
        with torch.no_grad():
            torch_hidden = reference(torch.from_numpy(observed), torch_hidden)
            wanted = reference.head(torch_hidden)
            wanted[~torch.from_numpy(legal)] = -torch.inf
        chosen = best_actions(values, legal)
        np.testing.assert_array_equal(chosen, wanted.argmax(dim=1).numpy())
        answers |= set(chosen.tolist())
    assert answers == set(range(N_ACTIONS))


@pytest.mark.parametrize('hidden_size', [1, 5, 16, 64, 96])
@pytest.mark.parametrize('n_rows', [1, 2, 7, 50])
def test_a_decision_in_a_batch_gets_the_bits_that_it_gets_alone(
    hidden_size: int, n_rows: int
) -> None:
    of = header(hidden_size=hidden_size)
    policy, rng = random_policy(of), np.random.default_rng(n_rows)
    observed = observations(2 * n_rows, of.observation_size, rng)[::2]  # also of rows apart
    hidden = rng.uniform(-1.0, 1.0, (n_rows, hidden_size))
    values, after = policy.step(observed, hidden)
    for row in range(n_rows):
        alone, after_alone = policy.step(observed[row : row + 1].copy(), hidden[row : row + 1])
        np.testing.assert_array_equal(alone[0], values[row])
        np.testing.assert_array_equal(after_alone[0], after[row])


def test_a_step_leaves_what_it_was_given_as_it_was() -> None:
    of = header()
    policy, rng = random_policy(of), np.random.default_rng(0)
    observed, hidden = observations(3, of.observation_size, rng), np.ones((3, 16))
    before = observed.copy()
    policy.step(observed, hidden)
    np.testing.assert_array_equal(observed, before)
    np.testing.assert_array_equal(hidden, 1.0)


def test_huge_weights_give_values_all_the_same() -> None:
    of = header(hidden_size=4)
    policy = random_policy(of, scale=1e30)
    values, hidden = policy.step(np.ones((1, of.observation_size)), policy.new_hidden(1))
    assert np.isfinite(values).all()
    assert np.isfinite(hidden).all()


def test_the_best_action_is_legal_and_of_equals_the_lowest() -> None:
    values = np.array([[1.0, 5.0, 5.0, 2.0, 5.0]] * 4)
    legal = np.array([[1, 1, 1, 1, 1], [1, 0, 1, 1, 1], [1, 0, 0, 1, 0], [0, 0, 0, 0, 1]]) == 1
    assert best_actions(values, legal).tolist() == [1, 2, 3, 4]


# The file


def test_a_policy_reads_back_as_it_was_written(tmp_path: Path) -> None:
    of = header(Layout.PAPER, side=8, n_uavs=3, hidden_size=7)
    written = random_policy(of, seed=4)
    save_policy(tmp_path / 'one.safetensors', written)
    read = load_policy(tmp_path / 'one.safetensors')
    assert read.header == of
    assert read.digest == written.digest == weights_digest(random_weights(of, 4, 3.0))
    for name, tensor in written.weights.items():
        np.testing.assert_array_equal(read.weights[name], tensor)
    assert [file.name for file in tmp_path.iterdir()] == ['one.safetensors']


def test_equal_policies_are_written_as_equal_bytes() -> None:
    policy = random_policy(header())
    assert len({policy_bytes(policy) for _ in range(5)}) == 1


def test_the_digest_changes_with_any_weight() -> None:
    weights = dict(random_weights(header()))
    before = weights_digest(weights)
    assert weights_digest(dict(reversed(weights.items()))) == before
    nudged = weights['head.bias'].copy()
    nudged[-1] = np.nextafter(nudged[-1], np.float32(1.0))
    assert weights_digest({**weights, 'head.bias': nudged}) != before


def test_a_failed_write_leaves_the_file_that_was_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = saved(tmp_path, 'kept', header())
    before = path.read_bytes()

    def full(_: int) -> None:
        raise OSError(28, 'No space left on device')

    monkeypatch.setattr('os.fsync', full)
    with pytest.raises(OSError, match='No space left'):
        save_policy(path, random_policy(header(), seed=9))
    assert path.read_bytes() == before
    assert [*tmp_path.iterdir()] == [path]


def rewrite(
    path: Path,
    metadata: dict[str, str | None] | None = None,
    tensors: dict[str, np.ndarray | None] | None = None,
) -> None:
    """Change strings or tensors of a file, or take them away, and leave the rest alone."""
    with safe_open(path, framework='numpy') as file:
        old_metadata = dict(file.metadata())
        old_tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    strings = {**old_metadata, **(metadata or {})}
    arrays = {**old_tensors, **(tensors or {})}
    save_file(
        {name: array for name, array in arrays.items() if array is not None},
        path,
        {name: text for name, text in strings.items() if text is not None},
    )


def test_a_file_says_what_was_learned_on_even_without_limits(tmp_path: Path) -> None:
    known = tuple(
        learned_on(load('paper_10x10', {'radio.contact_range_m': range_m}))
        for range_m in (1.0 / 3.0, np.inf)
    )
    path = saved(tmp_path, 'mine', header(learned_on=known))
    assert load_policy(path).header.learned_on == known


def test_a_file_that_does_not_say_what_was_learned_on_is_read(tmp_path: Path) -> None:
    path = of_before(saved(tmp_path, 'mine', header()), learned_on=None)
    assert load_policy(path).header == header()


def test_a_file_of_before_is_read_and_known_as_one(tmp_path: Path) -> None:
    path = saved(tmp_path, 'mine', header())
    assert load_policy(path).is_header_covered
    assert outdated('mine', load_policy(path)) is None
    old = load_policy(of_before(path, seed='4'))
    assert old.header == header(seed=4)
    line = outdated('mine', old) or ''
    assert line.startswith(f'policy mine is of {WEIGHTS_FORMAT}: its digest covers the weights,')
    save_policy(path, old)
    assert load_policy(path).header == header(seed=4)
    assert load_policy(path).is_header_covered


def test_what_flies_a_file_of_before_says_so_once(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = of_before(saved(tmp_path, 'mine', header(side=8)))
    options = ['--missions', '1', '--set', 'fleet.default.energy_budget_kj=20']
    assert main(['evaluate', '--scenario', 'paper_8x8', '--policy', str(path), *options]) == 0
    said = capsys.readouterr().err.splitlines()
    assert sum(WEIGHTS_FORMAT in line for line in said) == 1


def test_a_tool_writes_files_of_before_anew_and_leaves_others_alone(tmp_path: Path) -> None:
    new = saved(tmp_path, 'new', header())
    old = of_before(saved(tmp_path, 'old', header()))
    whole, tool = new.read_bytes(), Path(__file__).parents[2] / 'tools' / 'rewrite_policies.py'
    before = new.stat().st_mtime_ns
    done = completed(sys.executable, tool, new, old)
    assert done.stdout == f'{old}: written anew, version test @ 100, 89abcdef\n'
    assert old.read_bytes() == whole
    assert new.stat().st_mtime_ns == before


def test_shipped_policies_are_of_todays_format() -> None:
    assert all(frozen_policy(name).is_header_covered for name in shipped_policies())


def validated(**values: object) -> dict[str, str]:
    return {'validation': json.dumps({**asdict(VALIDATION), **values})}


def not_finite(name: str, value: float) -> dict[str, np.ndarray | None]:
    tensor = random_weights(header())[name].copy()
    tensor.flat[17] = value
    return {name: tensor}


@pytest.mark.parametrize(
    ('change', 'words'),
    [
        ({'metadata': {'format': 'other/1'}}, ["format is 'other/1'", FORMAT]),
        ({'metadata': {'format': None}}, ['format is missing']),
        ({'metadata': {'layout': 'egocentric/1'}}, ["layout is 'egocentric/1'", 'paper/1 or ego']),
        ({'metadata': {'seed': None}}, ['seed is missing']),
        ({'metadata': {'updates': 'many'}}, ["updates is 'many'", 'whole number']),
        ({'metadata': {'updates': '9' * 5000}}, ["updates is '999", 'whole number']),
        ({'metadata': {'hidden_size': '4097'}}, ['hidden_size is 4097', '1 to 4096']),
        ({'metadata': {'cells_per_side_max': '65'}}, ['cells_per_side_max is 65', '10 to 64']),
        ({'metadata': {'version': 'a\nb'}}, [r"version is 'a\nb'", 'printable']),
        ({'metadata': {'version': 'a' * 5000}}, ["version is 'aaa", '4096 printable']),
        ({'metadata': validated(safe_share=5.25)}, ['validation.safe_share is 5.25', '0 to 1']),
        ({'metadata': validated(energy_kj=np.nan)}, ['validation.energy_kj is .nan', '0 to 1e']),
        ({'metadata': validated(energy_kj=10**400)}, ['validation.energy_kj is 1000', '0 to 1e']),
        ({'metadata': validated(missions=True)}, ['validation.missions is true', 'whole']),
        ({'metadata': validated(bandwidth=7)}, ['validation.bandwidth is 7', 'text']),
        (
            {'metadata': {'validation': '{"missions": 1, "missions": 2}'}},
            ['validation is', 'JSON'],
        ),
        ({'metadata': {'validation': '[' * 99999}}, ['validation is', 'JSON object']),
        ({'metadata': {'hidden_size': '0'}}, ['hidden_size is 0']),
        ({'metadata': {'hidden_size': '17'}}, ['encoder.weight has shape [16,', 'must be [17,']),
        ({'metadata': {'observation_size': '300'}}, ['observation_size is 300', 'egocentric/2']),
        ({'metadata': {'cells_per_side_min': '11'}}, ['cells_per_side_min is 11', '1 to 10']),
        ({'metadata': {'n_uavs_max': '7'}}, ['n_uavs_max is 7', '2 to 6']),
        ({'metadata': {'n_uavs_min': '0'}}, ['n_uavs_min is 0', '1 to 2']),
        ({'metadata': {'validation': '[1]'}}, ["validation is '[1]'", 'efficiency_kbit_per_j']),
        ({'metadata': {'learned_on': '{}'}}, ["learned_on is '{}'", 'a JSON list', 'speeds_mps']),
        ({'metadata': {'learned_on': '[{}]'}}, ["learned_on is '[{}]'", 'contact_range_m']),
        ({'metadata': {'digest': 'abc'}}, ["digest is 'abc'", 'must be']),
        ({'tensors': {'head.bias': None}}, ["tensor 'head.bias' is missing", 'encoder.weight']),
        ({'tensors': {'mixer.bias': np.zeros(1, np.float32)}}, ["tensor 'mixer.bias' is unknown"]),
        (
            {'tensors': {'head.bias': np.zeros(6, np.float32)}},
            ['bias has shape [6]', 'be [5]'],
        ),
        ({'tensors': {'head.bias': np.zeros(5)}}, ["'head.bias' is 'F64'", 'F32']),
        ({'tensors': {'head.bias': np.zeros(5, np.float32)}}, ['digest is']),
        ({'tensors': not_finite('gru.weight_hh', np.nan)}, ['gru.weight_hh is nan at (1, 1)']),
        ({'tensors': not_finite('encoder.weight', np.inf)}, ['encoder.weight is inf at (0, 17)']),
    ],
    ids=lambda value: str(value)[:60] if isinstance(value, dict) else '',
)
def test_a_file_that_is_no_policy_is_refused_by_file_field_and_value(
    change: dict[str, dict], words: list[str], tmp_path: Path
) -> None:
    path = saved(tmp_path, 'mine', header())
    rewrite(path, **change)
    with pytest.raises(PolicyMismatchError) as refusal:
        load_policy(path)
    message = str(refusal.value)
    assert message.startswith(f'{path}: ')
    assert '\n' not in message
    assert len(message) < 400 + len(str(path))
    for word in words:
        assert word in message


def truncated(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-100])


def emptied(path: Path) -> None:
    path.write_bytes(b'')


def replaced_by_text(path: Path) -> None:
    path.write_text('these are no weights\n' * 100)


def removed(path: Path) -> None:
    path.unlink()


def made_a_folder(path: Path) -> None:
    path.unlink()
    path.mkdir()


def without_metadata(path: Path) -> None:
    save_file({'head.bias': np.zeros(5, np.float32)}, path)


@pytest.mark.parametrize(
    ('damage', 'words'),
    [
        (truncated, 'not a whole safetensors file'),
        (emptied, 'not a whole safetensors file'),
        (replaced_by_text, 'not a whole safetensors file'),
        (removed, 'cannot be read'),
        (made_a_folder, 'cannot be read'),
        (without_metadata, 'format is missing'),
    ],
    ids=lambda value: getattr(value, '__name__', ''),
)
def test_a_file_that_cannot_be_read_is_refused_in_one_line(
    damage: Callable[[Path], None], words: str, tmp_path: Path
) -> None:
    path = saved(tmp_path, 'mine', header())
    damage(path)
    with pytest.raises(PolicyMismatchError) as refusal:
        load_policy(path)
    assert str(refusal.value).startswith(f'{path}: ')
    assert words in str(refusal.value)
    assert '\n' not in str(refusal.value)


def made_a_pipe(path: Path) -> None:
    path.unlink()
    os.mkfifo(path)


def made_a_device(path: Path) -> None:
    path.unlink()
    path.symlink_to('/dev/zero')


def made_two_gigabytes(path: Path) -> None:
    os.truncate(path, 1 << 31)


def made_two_gigabytes_of_head(path: Path) -> None:
    path.write_bytes((1 << 31).to_bytes(8, 'little'))
    os.truncate(path, (1 << 31) + 8)


def made_two_gigabytes_of_a_users_network(path: Path) -> None:
    """Whose shapes only its class knows."""
    with path.open('rb') as file:
        texts = read_head(file, path.stat().st_size).texts
    entry = {'dtype': 'F32', 'shape': [1 << 29], 'data_offsets': [0, 1 << 31]}
    named = {**texts, 'network': 'my_networks:Wide'}
    head = json.dumps({'__metadata__': named, 'weight': entry}).encode()
    path.write_bytes(len(head).to_bytes(8, 'little') + head)
    os.truncate(path, 8 + len(head) + (1 << 31))


@pytest.mark.parametrize(
    ('damage', 'words'),
    [
        (made_two_gigabytes_of_a_users_network, 'its tensors are 2147483648 bytes long: must be'),
        (made_a_pipe, 'is a pipe or a device: must be a file'),
        (made_a_device, 'is a pipe or a device: must be a file'),
        (made_a_folder, 'is a folder: must be a file'),
        (made_two_gigabytes, 'bytes at its end belong to no tensor'),
        (made_two_gigabytes_of_head, 'its head is 2147483648 bytes long: must be 1048576 or less'),
    ],
    ids=lambda value: getattr(value, '__name__', ''),
)
def test_what_cannot_be_a_policy_costs_neither_memory_nor_time(
    damage: Callable[[Path], None], words: str, tmp_path: Path
) -> None:
    path = saved(tmp_path, 'mine', header())
    damage(path)
    tracemalloc.start()
    with pytest.raises(PolicyMismatchError, match=words):
        load_policy(path)
    _, most_byte = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert most_byte < 1_000_000


def test_a_byte_that_changes_anywhere_in_a_file_is_noticed() -> None:
    policy = random_policy(header(Layout.PAPER, side=2, hidden_size=1))
    whole = policy_bytes(policy)
    assert policy_from_bytes(whole).header == policy.header
    for place, was in enumerate(whole):
        for now in {was ^ 1, was ^ 0x20, was ^ 0x80, *b'129 \t'} - {was}:
            with pytest.raises(PolicyMismatchError) as refusal:
                policy_from_bytes(whole[:place] + bytes([now]) + whole[place + 1 :])
            assert '\n' not in str(refusal.value)


def test_a_digest_is_that_of_the_file_with_zeros_in_its_place() -> None:
    content = policy_bytes(random_policy(header(version='"digest":"1"')))
    head = json.loads(content[8 : 8 + int.from_bytes(content[:8], 'little')])
    digest = head['__metadata__']['digest']
    zeros = content.replace(digest.encode(), b'0' * 64)
    assert digest == hashlib.sha256(zeros).hexdigest()
    assert policy_from_bytes(content).header.version == '"digest":"1"'


def test_wrong_weights_never_become_a_policy() -> None:
    of = header()
    weights = dict(random_weights(of))
    refuse = partial(pytest.raises, PolicyMismatchError)
    with refuse(match='gru.bias_ih has shape'):
        FrozenPolicy(of, {**weights, 'gru.bias_ih': np.zeros(16, np.float32)})
    with refuse(match='gru.bias_ih is float64: must be float32'):
        FrozenPolicy(of, {**weights, 'gru.bias_ih': np.zeros(48)})
    with refuse(match='observation_size'):
        FrozenPolicy(replace(of, observation_size=3), weights)


# Which missions a policy may fly


def test_a_policy_says_which_areas_and_fleets_it_does_not_fit() -> None:
    of = header(side=10, cells_per_side_min=8, cells_per_side_max=12, n_uavs_min=2, n_uavs_max=3)
    policy = random_policy(of)
    for side in (8, 10, 12):
        assert (
            policy.header.misfit(brief(load('paper_10x10', {'area.cells_per_side': side}))) is None
        )
    small = brief(tiny())
    assert policy.header.misfit(small) == 'area is 4 x 4 cells: must have 8 to 12 rows and columns'
    alone = brief(load('paper_10x10', {'fleet.uavs': [{'speed_mps': 5.0}]}))
    assert policy.header.misfit(alone) == 'n_uavs is 1: must be 2 to 3'
    paper = random_policy(header(Layout.PAPER))
    assert paper.header.misfit(small) == 'area is 4 x 4 cells: must have 10 rows and columns'


def test_a_paper_policy_cannot_claim_two_areas() -> None:
    of = header(Layout.PAPER, cells_per_side_min=8)
    with pytest.raises(PolicyMismatchError, match='observation_size is 119: must be 83 for paper'):
        FrozenPolicy(of, random_weights(of))


def test_a_policy_is_loaded_and_asked_without_torch_or_numba(tmp_path: Path) -> None:
    path = saved(tmp_path, 'mine', header())
    script = """
from uav_collect.kernels.compile import interpret_kernels
interpret_kernels()
import sys
from uav_collect.uav.policy import policy_named
policy = policy_named(sys.argv[1])
import json
print(json.dumps([policy.name, policy.version, *sys.modules]))
"""
    done = completed(sys.executable, '-c', script, path)
    name, version, *modules = json.loads(done.stdout)
    assert (name, version) == ('mine', 'test @ 100, 89abcdef')
    assert {'torch', 'numba', 'scipy', 'cvxpy'} & set(modules) == set()
