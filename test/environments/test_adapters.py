"""The examples that bring missions to other learners run, if their packages are there."""

from importlib.util import find_spec
import os
from pathlib import Path
import re
import sys

from documents import blocks, page
import numpy as np
from processes import completed
import pytest
from uav_collect.environments.parallel import parallel_env
from uav_collect.scenario.load import load

from examples.epymarl_env import UavCollectEnv

ROOT = Path(__file__).parents[2]


def test_epymarl_gets_what_its_interface_says() -> None:
    world = UavCollectEnv('paper_8x8', time_limit=5, seed=3, reward_scalarisation='sum')
    twin = parallel_env('paper_8x8', reward='energy')
    observed, infos = twin.reset(seed=3)
    said, rng = world.get_env_info(), np.random.default_rng(0)
    assert said['n_agents'] == len(world.reset()[0]) == 2
    for step in range(5):
        assert [seen.tolist() for seen in world.get_obs()] == [
            seen.tolist() for seen in observed.values()
        ]
        assert world.get_state().tolist() == twin.state().tolist()
        masks = np.array(world.get_avail_actions())
        assert masks.tolist() == [info['action_mask'].tolist() for info in infos.values()]
        actions = (masks * rng.uniform(0.1, 1.0, masks.shape)).argmax(axis=1)
        _, reward, is_over, is_cut, info = world.step(actions)
        chosen = dict(zip(twin.agents, actions.tolist(), strict=True))
        observed, rewards, _, _, infos = twin.step(chosen)
        assert reward == sum(rewards.values())
        assert (is_over, is_cut) == (False, step == 4)
    assert info['episode_limit']
    assert 0.0 <= info['collected_share'] <= 1.0
    assert (said['n_actions'], said['episode_limit']) == (5, 5)
    assert world.get_obs_agent(1).shape == (said['obs_shape'],)
    assert world.get_state().shape == (said['state_shape'],)


def test_epymarl_hears_of_a_mission_that_is_cut_off_before_its_time_limit() -> None:
    world = UavCollectEnv('paper_8x8', time_limit=50, seed=3, max_decisions=4)
    world.reset()
    for is_last in (False, True):
        actions = np.array(world.get_avail_actions()).argmax(axis=1)
        _, _, is_over, is_cut, info = world.step(actions)
        assert (is_over, is_cut, 'episode_limit' in info) == (False, is_last, is_last)


def test_ppo_learns_by_masked_actions_and_repeats_itself() -> None:
    pytest.importorskip('torch', reason='needs torch')
    from examples.ppo import Settings, train

    uavs = [{'speed_mps': 10.0, 'energy_budget_kj': 10.0}] * 2
    short = load('paper_8x8', {'fleet.uavs': uavs})
    settings = Settings(n_worlds=2, n_steps=30, n_epochs=2, n_minibatches=2, hidden_size=16)
    first, second = (train(short, 180, 0, settings) for _ in range(2))
    assert first == second != []
    assert all(0.0 <= share <= 1.0 for _, _, share in first)


def test_ppo_refuses_fewer_decisions_than_an_update_takes() -> None:
    pytest.importorskip('torch', reason='needs torch')
    from examples.ppo import Settings, train

    with pytest.raises(ValueError, match='n_decisions is 59: must be 60 or more'):
        train('paper_8x8', 59, 0, Settings(n_worlds=2, n_steps=30))


def test_ppo_says_that_no_mission_has_ended() -> None:
    pytest.importorskip('torch', reason='needs torch')
    from examples.ppo import lines_of, Settings, train

    rows = train('paper_8x8', 4, 0, Settings(n_worlds=2, n_steps=2, hidden_size=8))
    assert lines_of(rows) == ['no mission has ended: it takes more --decisions']
    ended = lines_of([(4096, 0.5, 0.25), (8192, 1.0, 1.0)])
    assert ended[0].strip() == '4,096 decisions: 0.500 kbit/J, 25% of the data'
    assert len(ended) == 2


def test_the_programs_of_the_page_run(capsys: pytest.CaptureFixture[str]) -> None:
    for program in blocks(page('rl.md'), 'python'):
        exec(program, {'__name__': 'page'})
    decisions, arrays = capsys.readouterr().out.splitlines()
    assert re.fullmatch(r'4\d decisions', decisions)
    assert re.fullmatch(r'\(4, \d+\) float32', arrays)


@pytest.mark.parametrize(
    ('package', 'example', 'amount'),
    [('tianshou', 'tianshou_dqn.py', '--decisions'), ('torchrl', 'torchrl_ppo.py', '--steps')],
)
def test_an_adapter_trains_where_its_package_is(package: str, example: str, amount: str) -> None:
    if find_spec(package) is None:
        pytest.skip(f'needs {package}, which is in no requirements: pip install {package}')
    environment = {'UAV_COLLECT_KERNELS': 'interpreted', 'PYTHONPATH': str(ROOT)}
    program = ROOT / 'examples' / example
    completed(sys.executable, program, amount, '100', env=os.environ | environment)


def test_advantages_are_discounted_sums_of_errors_that_stop_where_missions_do() -> None:
    torch = pytest.importorskip('torch', reason='needs torch')
    from examples.ppo import Rollout

    rollout = Rollout(3, 1, 1, 1)
    rollout.reward[:, 0] = torch.tensor([1.0, 2.0, 4.0])
    rollout.value[:, 0] = torch.tensor([10.0, 20.0, 40.0])
    rollout.discount[:, 0] = torch.tensor([0.5, 0.25, 0.5])
    rollout.is_last[1, 0], rollout.cut_value[1, 0] = True, 8.0
    found = rollout.advantages(torch.tensor([2.0]), 0.5)[:, 0]
    last, cut_off = 4.0 + 0.5 * 2.0 - 40.0, 2.0 + 0.25 * 8.0 - 20.0
    assert found.tolist() == [1.0 + 0.5 * 20.0 - 10.0 + 0.5 * 0.5 * cut_off, cut_off, last]
