"""The launch file of a training, read by stand-ins for `launch`."""

from pathlib import Path
from types import SimpleNamespace

from launch_recorder import (
    defaults,
    described_by,
    ended,
    exit_handler,
    given,
    Made,
    nodes,
    NODES_FILE,
    ROOT,
    started,
)
import pytest
from uav_collect.errors import ConfigError, FleetError
from uav_collect.scenario.load import load
from uav_collect.training.config import load_preset
from uav_collect.training.seeds import first_training_seed

pytest.importorskip('rclpy')

LAUNCH_FILE = ROOT / 'launch' / 'training.launch.py'


@pytest.fixture
def description(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Made:
    """What the launch file describes, read in a folder of the test's own."""
    monkeypatch.chdir(tmp_path)
    return described_by(LAUNCH_FILE, monkeypatch)


def test_it_declares_its_arguments_with_the_defaults_of_the_trainer(description: Made) -> None:
    assert defaults(description) == {
        'scenario': 'paper_10x10',
        'algorithm': 'aqmix',
        'preset': 'strong',
        'seed': '0',
        'minutes': '0.0',
        'output_dir': '',
        'worlds': '1',
        'record': 'false',
    }


@pytest.mark.parametrize(('worlds', 'names'), [('1', ['']), ('3', ['a', 'b', 'c'])])
def test_each_world_has_a_name_a_fleet_and_missions_of_its_own(
    description: Made, worlds: str, names: list[str]
) -> None:
    made = nodes(description, 'world_sim', worlds=worlds, seed='5', output_dir='run')
    named = [['--world', name] if name else [] for name in names]
    assert [world.options['arguments'] for world in made] == named
    seeds = [world.options['parameters'][-1]['seed'] for world in made]
    assert seeds == [first_training_seed(5, number) for number in range(len(names))]
    agents = nodes(description, 'uav_agent', worlds=worlds, output_dir='run')
    ids = [[*flags, '--id', uav] for flags in named for uav in ('1', '2')]
    assert [agent.options['arguments'] for agent in agents] == ids


def test_each_launch_of_a_run_flies_missions_and_keeps_bags_of_its_own(
    description: Made, tmp_path: Path
) -> None:
    chosen = {'worlds': '2', 'seed': '5', 'output_dir': str(tmp_path / 'run'), 'record': 'true'}
    bags: list[object] = []
    for launch in range(3):
        made = nodes(description, 'world_sim', **chosen)
        seeds = [world.options['parameters'][-1]['seed'] for world in made]
        # Asking for the recorders describes it all anew.
        assert seeds == [first_training_seed(5, number, 2 * launch) for number in (0, 1)]
        bags += [given(one, 'output_dir')[0] for one in nodes(description, 'recorder', **chosen)]
        for bag in bags:
            Path(str(bag)).mkdir(exist_ok=True)
    names = ['run_bag_a', 'run_bag_b', 'run_bag_a_2', 'run_bag_b_2', 'run_bag_a_3', 'run_bag_b_3']
    assert bags == [str(tmp_path / name) for name in names]


def test_worlds_and_agents_fly_as_the_preset_trains(description: Made) -> None:
    scenario, config = load('paper_8x8'), load_preset('strong')
    (world,) = nodes(description, 'world_sim', scenario='paper_8x8', output_dir='run')
    values = world.options['parameters'][-1]
    shown = (values['viewer_rate_hz'], values['sample_rate_hz'])
    assert (values['missions'], shown) == (-1, (0.0, 0.0))
    assert values['max_decisions'] == config.max_decisions(scenario.n_cells)
    for agent in nodes(description, 'uav_agent', scenario='paper_8x8', output_dir='run'):
        assert given(agent, 'policy') == ('topic', str)
        assert given(agent, 'bandwidth') == (config.rollout.bandwidth, str)


def test_the_trainer_hears_all_worlds_and_its_end_ends_all(description: Made) -> None:
    (trainer,) = nodes(description, 'trainer', worlds='2', output_dir='2024')
    assert trainer.options['parameters'][0] == str(NODES_FILE)
    assert trainer.options['parameters'][-1]['worlds'] == ['a', 'b']
    assert given(trainer, 'output_dir') == ('2024', str)
    assert given(trainer, 'seed') == (0, int)
    parts = started(description, output_dir='2024')
    on_exit, running = exit_handler(parts), SimpleNamespace(is_shutdown=False)
    *others, trainer = (part for part in parts if part.kind == 'Node')
    assert trainer.options['executable'] == 'trainer'
    (end,) = on_exit(ended(trainer, 0), running)
    assert end.options['event'].kind == 'Shutdown'
    for node in (*others, trainer):
        with pytest.raises(FleetError, match='it-1 failed with exit status 1'):
            on_exit(ended(node, 1), running)


@pytest.mark.parametrize(
    ('name', 'text', 'words'),
    [
        ('output_dir', '', 'must be given'),
        ('algorithm', 'qmix', 'must be aqmix or aiql'),
        ('preset', 'nope', 'nope'),
        ('worlds', '17', 'must be a whole number from 1 to 16'),
        ('worlds', 'two', 'must be a whole number from 1 to 16'),
        ('minutes', '-1', 'must be a number from 0.0'),
        ('seed', 'abc', 'must be a whole number from 0'),
        ('record', '1', 'must be one of false, true, learning'),
        ('scenario', 'no_such', 'no_such'),
    ],
)
def test_a_wrong_argument_is_named_before_anything_starts(
    description: Made, name: str, text: str, words: str, tmp_path: Path
) -> None:
    with pytest.raises(ConfigError) as refused:
        started(description, **{'output_dir': 'run', name: text})
    assert str(refused.value).startswith(f'{name}:={text}: ')
    assert words in str(refused.value)
    assert [*tmp_path.iterdir()] == []


def test_each_world_is_recorded_on_request(description: Made) -> None:
    assert nodes(description, 'recorder', output_dir='run') == []
    made = nodes(description, 'recorder', record='true', worlds='2', output_dir='run')
    assert [given(one, 'output_dir')[0] for one in made] == ['run_bag_a', 'run_bag_b']
    assert {given(one, 'topics') for one in made} == {('all', str)}
    (less,) = nodes(description, 'recorder', record='learning', output_dir='run')
    assert given(less, 'topics') == ('learning', str)
    (alone,) = nodes(description, 'recorder', record='true', output_dir='run')
    assert given(alone, 'output_dir')[0] == 'run_bag'
