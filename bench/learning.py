"""Measures an update and a rollout on one core, beside a plain learner and the products' floor.

python bench/learning.py [--quick]

The plain learner is one as most are written, over padded steps: missions lie side by side as
steps; at each one every UAV's GRU cell runs, whether that UAV decides or another one, and what
belongs to no decision is masked afterwards, as EPyMARL's QLearner does. It learns the same as
`learning.learner` does, AQMIX with one-step targets or lambda-returns: losses and gradients agree
to rounding.
"""

from collections.abc import Callable, Iterator, Sequence
from copy import deepcopy
from dataclasses import replace
import sys
import time
from typing import Any, NamedTuple

import numpy as np
from rich.console import Console
from rich.table import Table
import torch
from torch import nn, Tensor
from uav_collect.learning.collector import Collector
from uav_collect.learning.learner import keep_freed_memory, Learner
from uav_collect.learning.minibatch import (
    Algorithm,
    make_excerpt_minibatch,
    make_minibatch,
    Minibatch,
    NO_DECISION,
)
from uav_collect.learning.network import Drqn, Networks
from uav_collect.learning.replay import Replay
from uav_collect.missions.experience import Episode, sparse_observations
from uav_collect.missions.vector_env import VectorEnv, VectorEnvConfig
from uav_collect.scenario.load import load
from uav_collect.scenario.model import Scenario
from uav_collect.scenario.site import build_site
from uav_collect.training.config import load_preset, TrainingConfig
from uav_collect.uav.action_codes import NONE
from uav_collect.uav.briefing import brief, Briefing

N_EVENTS = 120
EXCERPT_DECISIONS, BURN_IN = 8, 4  # as paper has them
SIZES = (('paper', 2), ('paper', 6), ('strong', 2))  # preset, UAVs
PLAIN_TARGETS = {('paper', 2): 1.75, ('paper', 6): 3.3}  # times faster than the plain learner
FLOOR_TARGET = 0.65  # of the speed that one large product has
ROLLOUT_TARGET = 20_000  # decisions per second
GEMM_SIZE = 2048
RATE = 1e-5


class Padded(NamedTuple):
    """N missions of up to T decisions; zeros where nothing is."""

    observation: Tensor  # (T, N, U, observation_size)
    legal: Tensor  # (T, N, U, N_ACTIONS), all where the UAV does not decide
    decides: Tensor  # (T, N, U)
    has_action: Tensor  # (T, N, U) running, or chosen here
    action: Tensor  # (T, N, U)
    fleet: Tensor  # (T, N, U * N_UAV_SCALARS)
    complete: Tensor  # (T, N, U + 1, C)
    reward: Tensor  # (T, N)
    discount: Tensor  # (T, N), 0 at the end
    is_entry: Tensor  # (T, N)


def padded(make_minibatch: Minibatch, n_decisions: Sequence[int], reward_scale: float) -> Padded:
    """A minibatch of AQMIX as dense steps.

    Args:
        n_decisions: of each mission, those whose outcome is not known included, shape (N,).
    """
    start = np.cumsum([0, *n_decisions])
    mission = np.repeat(np.arange(len(n_decisions)), n_decisions)
    step = np.arange(len(mission)) - start[mission]
    shape, (_, n_uavs) = (max(n_decisions), len(n_decisions)), make_minibatch.latest.shape

    def dense(values: Any, *inner: int, fill: float = 0.0) -> Tensor:  # noqa: ANN401 - any array
        table = np.full((*shape, *inner), fill, dtype=values.dtype)
        table[step, mission] = values
        return torch.from_numpy(table)

    deciding = make_minibatch.latest == np.arange(len(mission))[:, None]
    observation = deciding[..., None] * make_minibatch.observation[make_minibatch.row][:, None]
    legal = ~deciding[..., None] | make_minibatch.legal[make_minibatch.row][:, None]
    known = np.zeros((3, len(mission)))
    known[:, make_minibatch.entry] = [
        reward_scale * make_minibatch.reward,
        make_minibatch.discount,
        np.ones(len(make_minibatch.entry)),
    ]
    reward, discount, is_entry = known.astype(np.float32)
    return Padded(
        observation=dense(observation, n_uavs, observation.shape[2]),
        legal=dense(legal, n_uavs, legal.shape[2], fill=1.0),
        decides=dense(deciding, n_uavs),
        has_action=dense(make_minibatch.latest != NO_DECISION, n_uavs),
        action=dense(make_minibatch.action[np.maximum(make_minibatch.latest, 0)], n_uavs),
        fleet=dense(make_minibatch.fleet, make_minibatch.fleet.shape[1]),
        complete=dense(make_minibatch.complete, *make_minibatch.complete.shape[1:]),
        reward=dense(reward),
        discount=dense(discount),
        is_entry=dense(is_entry),
    )


def values_by_step(agent: Drqn, steps: Padded) -> Tensor:
    """Q values of every UAV at every step, by its own decisions so far, (T, N, U, N_ACTIONS)."""
    n_missions, n_uavs = steps.decides.shape[1:]
    hidden = steps.observation.new_zeros(n_missions * n_uavs, agent.hidden_size)
    values = []
    for observation, decides in zip(steps.observation, steps.decides, strict=True):
        encoded = torch.relu(agent.encoder(observation.flatten(0, 1)))
        hidden = torch.where(decides.view(-1, 1), agent.gru(encoded, hidden), hidden)
        values.append(agent.head(hidden).view(n_missions, n_uavs, -1))
    return torch.stack(values)


def plain_loss(
    networks: Networks, target: Networks, steps: Padded, *, double_q: bool, trace: float
) -> Tensor:
    """Mean squared error of the team's action values against their targets."""
    values = values_by_step(networks.agent, steps)
    team = _mixed(networks, _of(values, steps.action), steps)
    with torch.no_grad():
        later = values_by_step(target.agent, steps)
        judge = values if double_q else later
        best = judge.masked_fill(~steps.legal, -torch.inf).argmax(dim=3)
        greedy = torch.where(steps.decides, _of(later, best), _of(later, steps.action))
        goals = _goals(_mixed(target, greedy, steps), steps, trace)
    error = (team - goals) * steps.is_entry
    return error.square().sum() / steps.is_entry.sum()


def _goals(future: Tensor, steps: Padded, trace: float) -> Tensor:
    """What the team's values are to become, from the last step backwards, (T, N)."""
    goals = torch.zeros_like(future)
    goals[-1] = steps.reward[-1]
    for step in range(len(future) - 2, -1, -1):
        is_known = steps.is_entry[step + 1]
        share = trace * is_known
        after = (1.0 - share) * future[step + 1] + share * goals[step + 1]
        goals[step] = steps.reward[step] + steps.discount[step] * after
    return goals


def _of(values: Tensor, action: Tensor) -> Tensor:
    return values.gather(3, action[..., None]).squeeze(3)


def _mixed(networks: Networks, values: Tensor, steps: Padded) -> Tensor:
    mixer = networks.mixer(0)
    state = mixer.state(steps.fleet.flatten(0, 1), steps.complete.flatten(0, 1))
    total: Tensor = mixer((values * steps.has_action).flatten(0, 1), state)
    return total.view(steps.reward.shape)


def plain_update(learner: Learner, steps: Padded, config: TrainingConfig) -> None:
    """One step of the optimiser, plainly."""
    target, networks = learner.target, learner.networks
    how = {'double_q': config.target.double_q, 'trace': config.target.trace}
    loss = plain_loss(networks, target, steps, **how)
    learner.optimiser.zero_grad(set_to_none=True)
    loss.backward()
    nn.utils.clip_grad_norm_(networks.parameters(), config.optimiser.clip_norm)
    learner.optimiser.step()
    for slow, fast in zip(target.parameters(), networks.parameters(), strict=True):
        slow.data.lerp_(fast.data, config.target.update_rate)


def fleet_of(n_uavs: int) -> Scenario:
    """The paper's area; UAVs of 5 and 10 m/s in turn."""
    fleet = [{'speed_mps': (5.0, 10.0)[uav % 2]} for uav in range(n_uavs)]
    return load('paper_10x10', {'fleet.uavs': fleet})


def fly_randomly(scenario: Scenario, config: TrainingConfig) -> list[Episode]:
    """As many missions as a minibatch has, by random legal actions."""
    seeds = range(config.replay.missions_per_batch)
    stepping = VectorEnvConfig(
        layout=config.layout, reward=config.reward_kind, max_decisions=N_EVENTS
    )
    flights = VectorEnv(build_site(scenario), seeds, stepping)
    decisions, rng = flights.decisions, np.random.default_rng(0)
    for _ in range(N_EVENTS):
        drawn = decisions.legal * rng.uniform(0.1, 1.0, decisions.legal.shape)
        decisions = flights.step(drawn.argmax(axis=1))
    if (decisions.uav == NONE).any():
        raise RuntimeError(f'a mission was over before {N_EVENTS} events')
    return [flights.episode(world) for world in range(len(seeds))]


def n_flops(learner: Learner, batch: Minibatch) -> int:
    """Operations of the products of an update, as if observations had no zeros."""
    total = 0
    parts = (learner.networks.agent, len(batch.row)), (learner.networks.mixer(0), len(batch.entry))
    for part, n_rows in parts:
        for name, weight in part.named_parameters():
            # Forward in both networks; then the gradients of the weight and of what it is fed,
            # which are no weights' where that is an observation or a state.
            is_first = name == 'encoder.weight' or name.endswith('.0.weight')
            if weight.ndim == 2:
                total += 2 * n_rows * weight.numel() * (3 if is_first else 4)
    return total


class Case(NamedTuple):
    """What is measured side by side."""

    preset: str
    n_uavs: int
    n_flops: int
    calls: dict[str, Callable[[], Any]]  # by the keys of LABELS


def case(preset: str, n_uavs: int) -> Case:
    """The learners of a size, all with the same weights and missions."""
    scenario, config = fleet_of(n_uavs), load_preset(preset)
    flown, briefing = fly_randomly(scenario, config), brief(scenario)
    episodes = [
        replace(it, observation=sparse_observations(it, config.layout, briefing)) for it in flown
    ]

    def ready(missions: Sequence[Episode]) -> Minibatch:
        discount_per_s = config.reward.discount_per_s
        return make_minibatch(missions, briefing, config.layout, Algorithm.AQMIX, discount_per_s)

    batch = ready(episodes)
    steps = padded(batch, [it.n_decisions for it in episodes], config.reward.scale)
    packed = Learner(config, [briefing], Algorithm.AQMIX, seed=0)
    plain = Learner(config, [briefing], Algorithm.AQMIX, seed=0)
    rounded = load_preset(preset, {'optimiser.bf16': True})
    half = Learner(rounded, [briefing], Algorithm.AQMIX, seed=0)
    square = torch.rand(GEMM_SIZE, GEMM_SIZE)
    calls: dict[str, Callable[[], Any]] = {
        'product': lambda: square @ square,
        'plain': lambda: plain_update(plain, steps, config),
        'packed': lambda: packed.update([(batch, 0)], RATE),
        'bf16': lambda: half.update([(batch, 0)], RATE),
        'ready': lambda: ready(episodes),
        'rebuilt': lambda: ready(flown),
        'excerpts': excerpt_update(config, briefing, flown),
    }
    if torch.cuda.is_available():
        device = Learner(config, [briefing], Algorithm.AQMIX, seed=0, device='cuda')
        calls['cuda'] = lambda: device.update([(batch, 0)], RATE)
    check(packed, batch, steps, config)
    return Case(preset, n_uavs, n_flops(packed, batch), calls)


def excerpt_update(
    config: TrainingConfig, briefing: Briefing, flown: Sequence[Episode]
) -> Callable[[], object]:
    """An update by as many excerpts of the missions, drawn and made ready each time."""
    learner = Learner(config, [briefing], Algorithm.AQMIX, seed=0)
    replay = Replay(len(flown) * (N_EVENTS + 1), briefing, config.layout)
    for episode in flown:
        replay.add(episode)
    rng = np.random.default_rng(0)

    def update() -> object:
        drawn = replay.sample_excerpts(len(flown), EXCERPT_DECISIONS, rng)
        how = config.layout, Algorithm.AQMIX, config.reward.discount_per_s
        return learner.update([(make_excerpt_minibatch(drawn, BURN_IN, briefing, *how), 0)], RATE)

    return update


def check(learner: Learner, batch: Minibatch, steps: Padded, config: TrainingConfig) -> None:
    """Refuse to compare learners that do not learn the same."""
    how = {'double_q': config.target.double_q, 'trace': config.target.trace}
    with torch.no_grad():
        plain = float(plain_loss(learner.networks, deepcopy(learner.target), steps, **how))
        packed = float(learner.loss(batch))
    if abs(plain - packed) > 1e-5 * plain:
        raise RuntimeError(f'the loss is {packed:.8g}, of the plain learner {plain:.8g}')


def measure(measured: Case, n_repeats: int) -> dict[str, float]:
    """Call all in turn, so that whatever else the machine does hits all alike.

    Returns:
        The median time of each [s]; what the first call compiles or fetches is left out.
    """
    times_s: dict[str, list[float]] = {name: [] for name in measured.calls}
    for _ in range(n_repeats + 1):
        for name, call in measured.calls.items():
            # A device works beside the CPU; the loss that an update returns waits for it.
            clock = time.perf_counter if name == 'cuda' else time.process_time
            start_s = clock()
            call()
            times_s[name].append(clock() - start_s)
    return {name: float(np.median(times[1:])) for name, times in times_s.items()}


def coloured(text: str, *, is_kept: bool | None) -> str:
    """Green where a target is kept, red where it is not."""
    return text if is_kept is None else f'[{"green" if is_kept else "red"}]{text}[/]'


LABELS = {
    'plain': 'plain, over padded steps',
    'packed': 'packed',
    'bf16': 'packed, products in bfloat16',
    'cuda': 'packed, CUDA, wall time',
    'ready': 'making the minibatch ready',
    'rebuilt': 'the same, observations rebuilt',
    'excerpts': 'packed, of excerpts of 8, ready and learned',
}


def rows(measured: Case, median_s: dict[str, float]) -> Iterator[tuple[str, ...]]:
    """One row for each way, and one for the floor."""
    floor_s = measured.n_flops / (2 * GEMM_SIZE**3) * median_s['product']
    size = measured.preset, str(measured.n_uavs)
    for name, label in LABELS.items():
        if name not in median_s:
            continue
        faster, share = median_s['plain'] / median_s[name], floor_s / median_s[name]
        target = (
            PLAIN_TARGETS.get((measured.preset, measured.n_uavs)) if name == 'packed' else None
        )
        beside = (
            coloured(f'{faster:.2f}', is_kept=target and faster >= target),
            coloured(f'{share:.0%}', is_kept=target and share >= FLOOR_TARGET),
        )
        took = f'{median_s[name] * 1e3:.1f}'
        yield (*size, label, took, *(('', '') if name in ('ready', 'rebuilt') else beside))
    yield (*size, 'floor: its products alone', f'{floor_s * 1e3:.1f}', '', '')


def rollout_per_s(n_decisions: int) -> tuple[float, float, float]:
    """Decisions per second of CPU time: the rollout, its network alone, its world alone."""
    config, scenario = load_preset('strong'), fleet_of(2)
    collector = Collector(build_site(scenario), config, Algorithm.AQMIX, seed=0)
    agent = Learner(config, [brief(scenario)], Algorithm.AQMIX, seed=0).networks.agent
    n_worlds = config.rollout.missions_at_once
    observation = torch.rand(n_worlds, agent.encoder.in_features)
    hidden = torch.zeros(n_worlds, agent.hidden_size)
    flights = VectorEnv(build_site(scenario), range(n_worlds), VectorEnvConfig(reward=1))
    found = []
    for call, n_calls, n_each in (
        (lambda: collector.collect(agent, n_decisions, 0.05), 1, n_decisions),
        (lambda: agent.step(observation, hidden), 50, n_worlds),
        (lambda: flights.step(flights.decisions.legal.argmax(axis=1)), 50, n_worlds),
    ):
        with torch.no_grad():
            call()
            start_s = time.process_time()
            for _ in range(n_calls):
                call()
        found.append(n_calls * n_each / (time.process_time() - start_s))
    return found[0], found[1], found[2]


def main() -> None:
    """Measure and print."""
    is_quick = '--quick' in sys.argv[1:]
    torch.set_num_threads(1)
    keep_freed_memory()
    table = Table(
        title=f'An update of AQMIX on paper_10x10, missions of {N_EVENTS} events: CPU time in ms',
        caption='targets at the sizes of paper: packed at least 1.75 times as fast as the plain '
        f'learner with 2 UAVs and 3.3 with 6, and at least {FLOOR_TARGET:.0%} of the speed of its '
        f'products alone, taken from one of {GEMM_SIZE} x {GEMM_SIZE} numbers in the same run',
    )
    for heading in ('preset', 'UAVs', 'update', 'ms', 'plain / this', 'floor / this'):
        table.add_column(heading, justify='left' if heading in ('preset', 'update') else 'right')
    for preset, n_uavs in SIZES:
        measured = case(preset, n_uavs)
        for row in rows(measured, measure(measured, 3 if is_quick else 15)):
            table.add_row(*row)
    console = Console(width=None if sys.stdout.isatty() else 132)
    console.print(table)
    rollout, network, world = rollout_per_s(10_000 if is_quick else 100_000)
    per_s = coloured(f'{rollout:,.0f}', is_kept=rollout >= ROLLOUT_TARGET)
    console.print(
        f'rollout with the policy of strong: {per_s} decisions/s (target {ROLLOUT_TARGET:,}); its '
        f'network alone {network:,.0f}, its world alone {world:,.0f}'
    )


if __name__ == '__main__':
    main()
