"""The learner: what it learns is what a plain learner would, packed or not."""

from collections.abc import Sequence
from dataclasses import replace
import os
from pathlib import Path
import platform
import sys

from checkpoints import read_back
from episodes import batch_of, drawn_episode, single_threaded_torch, small
import numpy as np
from processes import completed
import pytest
from tiny_world import tiny, uav
from uav_collect.learning.minibatch import Algorithm, Minibatch
from uav_collect.scenario.model import Scenario
from uav_collect.uav.briefing import brief

torch = single_threaded_torch()
from uav_collect.learning.learner import Learner, reverse_scan
from uav_collect.learning.network import Networks

from bench.learning import padded, plain_loss, values_by_step

THREE = uav(5.0), uav(10.0), uav(7.5)
RATE = 1e-3
# test_branches.py has the other one.
Q_LEARNERS = Algorithm.AQMIX, Algorithm.QMIX, Algorithm.AIQL
COUNT_PAGES = """
import resource
import numpy as np
from uav_collect.learning.learner import keep_freed_memory

if {keeps}:
    keep_freed_memory()

def taken():
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt

for _ in range(3):
    pair = [np.ones(2_000_000) for _ in range(3)]
    del pair
before = taken()
for _ in range(10):
    pair = [np.ones(2_000_000) for _ in range(3)]
    del pair
print(taken() - before)
"""


def learner_of(
    algorithm: Algorithm = Algorithm.AQMIX, scenario: Scenario | None = None, **overrides: object
) -> Learner:
    config = small(**overrides)
    return Learner(config, [brief(scenario or tiny())], algorithm, seed=0)


def apart(learner: Learner) -> Learner:
    """The learner, its target no longer what it learns."""
    generator = torch.Generator().manual_seed(1)
    for parameter in learner.target.parameters():
        parameter.add_(0.3 * torch.randn(parameter.shape, generator=generator))
    return learner


def drawn_batch(
    algorithm: Algorithm = Algorithm.AQMIX,
    scenario: Scenario | None = None,
    sizes: Sequence[int] = (7, 1, 12, 5),
) -> Minibatch:
    scenario = scenario or tiny()
    episodes = [drawn_episode(brief(scenario), size, seed) for seed, size in enumerate(sizes)]
    # A mission of one decision that is cut off is nothing to learn from.
    episodes[1] = replace(episodes[1], is_whole=True)
    return batch_of(episodes, scenario, small(), algorithm)


def gradients(networks: Networks, loss: torch.Tensor) -> dict[str, torch.Tensor]:
    networks.zero_grad()
    loss.backward()
    return {name: it.grad.clone() for name, it in networks.named_parameters()}


def weights(networks: Networks) -> torch.Tensor:
    return torch.cat([it.detach().flatten() for it in networks.parameters()])


@pytest.mark.parametrize('double_q', [False, True])
@pytest.mark.parametrize('trace', [0.0, 0.7])
@pytest.mark.parametrize('fleet', [THREE[:1], THREE[:2], THREE])
@pytest.mark.parametrize('hidden_size', [8, 16])  # by torch; by kernels
def test_loss_and_gradients_are_those_of_a_plain_learner_over_padded_steps(
    hidden_size: int, fleet: Sequence[dict[str, object]], trace: float, double_q: bool
) -> None:
    scenario, sizes = tiny(*fleet), (7, 1, 12, 5)
    settings = {
        'target__trace': trace, 'target__double_q': double_q, 'network__hidden_size': hidden_size,
    }  # fmt: skip
    learner = apart(learner_of(scenario=scenario, **settings))
    batch = drawn_batch(scenario=scenario, sizes=sizes)
    steps = padded(batch, sizes, small().reward.scale)
    networks, target = learner.networks, learner.target
    plain = plain_loss(networks, target, steps, double_q=double_q, trace=trace)
    packed = learner.loss(batch)
    torch.testing.assert_close(packed, plain, rtol=1e-5, atol=0.0)
    theirs, ours = gradients(networks, plain), gradients(networks, packed)
    for name, gradient in theirs.items():
        assert (ours[name] - gradient).norm() <= 1e-5 * gradient.norm() + 1e-9, name


def test_every_uav_keeps_its_own_hidden_state_from_the_start_of_its_mission() -> None:
    # Step by step, each UAV of each mission alone, from a hidden state of zeros.
    learner, sizes = learner_of(), (7, 1, 12, 5)
    batch = drawn_batch(sizes=sizes)
    agent = learner.networks.agent
    values = agent(torch.from_numpy(batch.observation), batch.step_sizes)
    starts = np.cumsum([0, *sizes])
    for mission, start in enumerate(starts[:-1]):
        hidden = torch.zeros(2, 8)
        for decision in range(start, starts[mission + 1]):
            uav_index = int((batch.latest[decision] == decision).argmax())
            seen = torch.from_numpy(batch.observation[batch.row[decision]])
            own, hidden[uav_index] = agent.step(seen[None], hidden[uav_index][None].clone())
            torch.testing.assert_close(values[batch.row[decision]], own[0])


def test_an_agents_values_are_those_of_the_plain_rollout_at_every_decision() -> None:
    learner, sizes = learner_of(), (7, 1, 12, 5)
    batch = drawn_batch(sizes=sizes)
    packed = learner.networks.agent(torch.from_numpy(batch.observation), batch.step_sizes)
    steps = padded(batch, sizes, 1.0)
    plain = values_by_step(learner.networks.agent, steps)
    in_order = plain.transpose(0, 1)[steps.decides.transpose(0, 1)]
    torch.testing.assert_close(packed[batch.row], in_order)


@pytest.mark.parametrize('algorithm', Q_LEARNERS)
def test_missions_of_a_batch_do_not_see_each_other(algorithm: Algorithm) -> None:
    learner = apart(learner_of(algorithm, target__trace=0.7))
    scenario, sizes = tiny(), (7, 1, 12, 5)
    episodes = [drawn_episode(brief(scenario), size, seed) for seed, size in enumerate(sizes)]
    together = batch_of(episodes, scenario, small(), algorithm)
    alone = [batch_of([it], scenario, small(), algorithm) for it in episodes]
    goals = torch.cat([learner.targets(each) for each in alone])
    torch.testing.assert_close(learner.targets(together), goals, rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize('algorithm', Q_LEARNERS)
def test_every_parameter_gets_a_gradient(algorithm: Algorithm) -> None:
    learner = learner_of(algorithm)
    found = gradients(learner.networks, learner.loss(drawn_batch(algorithm)))
    assert {name.split('.')[0] for name in found} == (
        {'agent'} if algorithm is Algorithm.AIQL else {'agent', 'mixers'}
    )
    assert [name for name, gradient in found.items() if not gradient.abs().sum() > 0.0] == []


@pytest.mark.parametrize('algorithm', Q_LEARNERS)
def test_it_overfits_one_batch(algorithm: Algorithm) -> None:
    sizes = {'network__hidden_size': 32, 'mixer__embedding_size': 32}
    learner, batch = learner_of(algorithm, **sizes), drawn_batch(algorithm)
    losses = [learner.update([(batch, 0)], 0.003).loss for _ in range(150)]
    assert min(losses[-50:]) < 1e-3 * losses[0]


def test_the_loss_of_an_update_is_that_before_it() -> None:
    learner, batch = learner_of(), drawn_batch()
    before = float(learner.loss(batch).detach())
    assert learner.update([(batch, 0)], RATE).loss == pytest.approx(before)
    assert float(learner.loss(batch).detach()) < before
    assert learner.n_updates == 1


def test_an_update_on_several_minibatches_steps_along_the_mean_of_their_gradients() -> None:
    learner, batches = (
        learner_of(optimiser__clip_norm=1e6),
        [drawn_batch(), drawn_batch(sizes=(9, 3, 4))],
    )
    losses = [learner.loss(batch) for batch in batches]
    parameters = list(learner.networks.parameters())
    gradients = torch.autograd.grad(torch.stack(losses).mean(), parameters)
    norm = torch.linalg.vector_norm(torch.cat([it.flatten() for it in gradients]))
    metrics = learner.update([(batch, 0) for batch in batches], RATE)
    assert metrics.loss == pytest.approx(float(np.mean([it.item() for it in losses])))
    assert metrics.gradient_norm == pytest.approx(float(norm), rel=1e-4)
    assert learner.n_updates == 1


def test_an_update_uses_the_learning_rate_it_is_given() -> None:
    still, moved = learner_of(), learner_of()
    still.update([(drawn_batch(), 0)], 1e-30)
    moved.update([(drawn_batch(), 0)], RATE)
    assert torch.equal(weights(still.networks), weights(learner_of().networks))
    assert float((weights(moved.networks) - weights(still.networks)).abs().max()) == pytest.approx(
        RATE, rel=1e-3
    )  # Adam's first step


def test_the_target_network_moves_by_its_rate_towards_the_online_one() -> None:
    learner = learner_of(target__update_rate=0.25)
    before = weights(learner.target)
    learner.update([(drawn_batch(), 0)], 0.1)
    expected = before + 0.25 * (weights(learner.networks) - before)
    torch.testing.assert_close(weights(learner.target), expected)
    assert not torch.equal(weights(learner.target), weights(learner.networks))


def test_the_target_network_is_a_copy_that_gets_no_gradient() -> None:
    learner = learner_of()
    assert torch.equal(weights(learner.target), weights(learner.networks))
    own = {it.data_ptr() for it in learner.networks.parameters()}
    assert not own & {it.data_ptr() for it in learner.target.parameters()}
    learner.loss(drawn_batch()).backward()
    assert all(it.grad is None for it in learner.target.parameters())


def test_the_target_network_does_not_remember_how_it_came_about() -> None:
    # Else each update would leave its part of a graph behind.
    learner = learner_of()
    learner.update([(drawn_batch(), 0)], RATE)
    assert not any(it.requires_grad for it in learner.target.parameters())


def test_targets_come_from_the_target_network_and_values_from_the_online_one() -> None:
    learner, batch = learner_of(), drawn_batch()
    goals = learner.targets(batch)
    with torch.no_grad():
        for parameter in learner.networks.parameters():
            parameter.add_(0.1)
    assert torch.equal(learner.targets(batch), goals)
    assert not torch.equal(apart(learner).targets(batch), goals)


@pytest.mark.parametrize('algorithm', Q_LEARNERS)
def test_a_restored_learner_goes_on_as_the_one_that_was_saved(algorithm: Algorithm) -> None:
    batch, learner = drawn_batch(algorithm), learner_of(algorithm)
    for _ in range(3):
        learner.update([(batch, 0)], RATE)
    other = Learner(small(), [brief(tiny())], algorithm, seed=99)
    other.restore(read_back(learner.state()))
    assert other.n_updates == 3
    assert torch.equal(weights(other.target), weights(learner.target))
    losses = [[each.update([(batch, 0)], RATE) for _ in range(3)] for each in (learner, other)]
    assert losses[0] == losses[1]
    assert torch.equal(weights(other.networks), weights(learner.networks))
    assert torch.equal(weights(other.target), weights(learner.target))


def test_the_seed_draws_the_weights_and_nothing_else_does() -> None:
    torch.manual_seed(5)
    one = learner_of()
    drawn_after = torch.rand(1)
    torch.manual_seed(5)
    assert torch.equal(torch.rand(1), drawn_after)  # the global generator was left alone
    torch.manual_seed(6)
    assert torch.equal(weights(learner_of().networks), weights(one.networks))
    other = Learner(small(), [brief(tiny())], Algorithm.AQMIX, seed=1)
    assert not torch.equal(weights(other.networks), weights(one.networks))


def test_the_gradients_norm_is_clipped() -> None:
    learner = learner_of(optimiser__clip_norm=1e-6, optimiser__adam_epsilon=0.1)
    before = weights(learner.networks)
    learner.update([(drawn_batch(), 0)], RATE)
    # Adam's first step is rate g / (|g| + epsilon): gradients this small move next to nothing.
    assert 0.0 < float((weights(learner.networks) - before).norm()) < 2.0 * RATE * 1e-6 / 0.1


def test_rewards_are_scaled() -> None:
    plain, scaled = learner_of(), learner_of(reward__scale=0.1)
    batch = replace(drawn_batch(), discount=np.zeros_like(drawn_batch().discount))
    torch.testing.assert_close(scaled.targets(batch), 0.1 * plain.targets(batch))


def test_several_tasks_share_the_agent_and_have_a_mixer_each() -> None:
    scenarios = tiny(), tiny(*THREE)
    config = small(observation='egocentric')
    learner = Learner(config, [brief(it) for it in scenarios], Algorithm.AQMIX, seed=0)
    assert len(learner.networks.mixers) == 2
    for task, scenario in enumerate(scenarios):
        episodes = [drawn_episode(brief(scenario), 9, seed) for seed in range(3)]
        batch = batch_of(episodes, scenario, config)
        before = [weights(part) for part in parts(learner)]
        learner.update([(batch, task)], RATE)
        has_changed = [
            not torch.equal(weights(part), old)
            for part, old in zip(parts(learner), before, strict=True)
        ]
        assert has_changed == [True, task == 0, task == 1]


def parts(learner: Learner) -> list[torch.nn.Module]:
    return [learner.networks.agent, *learner.networks.mixers]


@pytest.mark.parametrize('size', [1, 2, 3, 8, 100])
def test_a_scan_is_the_plain_recursion(size: int) -> None:
    generator = torch.Generator().manual_seed(size)
    values, factors = torch.rand((2, size), generator=generator, dtype=torch.float64)
    factors[torch.rand(size, generator=generator) < 0.2] = 0.0  # ends of chains
    expected, total = [], 0.0
    for value, factor in zip(reversed(values.tolist()), reversed(factors.tolist()), strict=True):
        total = value + factor * total
        expected.append(total)
    solved = reverse_scan(values, factors)
    torch.testing.assert_close(solved, torch.tensor(expected[::-1], dtype=torch.float64))


@pytest.mark.skipif(platform.libc_ver()[0] != 'glibc', reason='malloc is not glibc')
def test_arrays_made_again_and_again_take_no_more_pages_from_the_system() -> None:
    environment = os.environ | {'PYTHONPATH': str(Path(__file__).parents[2])}
    scripts = [COUNT_PAGES.format(keeps=keeps) for keeps in (False, True)]
    pages = [int(completed(sys.executable, '-c', it, env=environment).stdout) for it in scripts]
    assert pages[1] < 100 < pages[0]
