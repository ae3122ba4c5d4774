"""What a user of Python gets from the package itself."""

import ast
from functools import partial
from pathlib import Path
import sys

from processes import completed
import pytest
from random_policies import header, saved
from tiny_world import tiny
import uav_collect
from uav_collect import api, FORWARD, HOME, HOVER, Situation, step_towards, UavCollectError

FACE = Path(uav_collect.__file__)
HEAVY = {
    'matplotlib',
    'numba',
    'numpy',
    'pettingzoo',
    'rclpy',
    'rich',
    'torch',
    'yaml',
}


def go_home(situation: Situation) -> int:
    """Gives up at once."""
    return HOME


def collect_below(situation: Situation) -> int:
    """Hovers where it can, else heads for the last cell, and flies home from there."""
    if situation.legal[HOVER]:
        return HOVER
    last = len(situation.belief.complete) - 1
    if situation.view.cell == last:
        return HOME
    return step_towards(situation.briefing, situation.view.cell, last, situation.legal)


def loaded_by(statement: str) -> set[str]:
    """Which packages a statement loads."""
    script = f'{statement}\nimport sys; print(*sys.modules)'
    shown = completed(sys.executable, '-c', script).stdout
    return {name.partition('.')[0] for name in shown.split()}


def test_importing_the_package_loads_nothing_heavy() -> None:
    assert loaded_by('import uav_collect') & HEAVY == set()
    assert loaded_by('import uav_collect; dir(uav_collect)') & HEAVY == set()
    assert loaded_by('from uav_collect import UavCollectError') & HEAVY == set()


def test_what_flies_missions_is_loaded_when_it_is_used() -> None:
    assert loaded_by('from uav_collect import fly, Situation') & HEAVY <= {'numpy', 'yaml'}
    assert {'numpy', 'rich'} <= loaded_by('from uav_collect import Evaluation')


def test_every_name_is_there_listed_and_described() -> None:
    for name in uav_collect.__all__:
        assert getattr(uav_collect, name) is not None
        assert name in dir(uav_collect)
        assert name == '__version__' or f'`{name}' in str(uav_collect.__doc__)


def test_type_checkers_and_programs_get_the_same_names_from_the_same_modules() -> None:
    [block] = [
        node
        for node in ast.parse(FACE.read_text()).body
        if isinstance(node, ast.If) and ast.unparse(node.test) == 'TYPE_CHECKING'
    ]
    checked = {
        str(node.module).removeprefix('uav_collect.'): tuple(sorted(it.name for it in node.names))
        for node in block.body
        if isinstance(node, ast.ImportFrom)
    }
    assert checked == uav_collect._NAMES_OF
    assert {*uav_collect._MODULE_OF, '__version__'} == {*uav_collect.__all__}


def test_a_name_that_is_not_there_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="'uav_collect' has no attribute 'land'"):
        _ = uav_collect.land


def test_a_mission_has_a_log_metrics_tables_and_a_picture(tmp_path: Path) -> None:
    mission = uav_collect.fly('paper_8x8', 'sweep', seed=3)
    assert mission.log.header.mission_seed == 3
    assert mission.metrics.is_complete
    assert mission.metrics == uav_collect.mission_metrics(mission.log)
    assert 'paper_8x8, mission seed 3: sweep, exact bandwidth' in str(mission)
    assert mission.demand_bit.sum() == pytest.approx(mission.metrics.total_bit)
    mission.draw(tmp_path / 'mission.png')
    assert (tmp_path / 'mission.png').read_bytes().startswith(b'\x89PNG')


def go_round(situation: Situation) -> int:
    """Takes the first legal move, which leads round the eastern columns."""
    return FORWARD + int(situation.legal[FORWARD:].argmax())


def test_a_policy_that_circles_is_guarded_as_patiently_as_is_asked_for() -> None:
    mission = uav_collect.fly('paper_8x8', go_round, seed=3)
    assert mission.metrics.is_complete
    assert 'by the guard' in str(mission)
    impatient, alone = (
        uav_collect.evaluate('paper_8x8', go_round, missions=1, seed=3, guard_after=after)
        for after in (1, 0)
    )
    assert impatient.metrics['go_round'][0].completion_s < mission.metrics.completion_s
    assert 'go_round: the guard took' in str(impatient)
    assert alone.metrics['go_round'][0].n_guarded == 0
    assert not alone.metrics['go_round'][0].is_complete


def test_scenarios_are_given_by_name_file_or_as_loaded(tmp_path: Path) -> None:
    file = tmp_path / 'tiny.yaml'
    file.write_text('extends: paper_8x8\nname: paper_8x8\n')
    logs = [
        uav_collect.fly(scenario, go_home).log.to_jsonl()
        for scenario in ('paper_8x8', file, uav_collect.load('paper_8x8'))
    ]
    assert logs == [logs[0]] * 3


def test_a_function_flies_as_under_its_name(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(Path(__file__).parent)
    by_function = uav_collect.fly('paper_8x8', collect_below)
    by_name = uav_collect.fly('paper_8x8', 'test_api:collect_below')
    assert by_function.log.events.tobytes() == by_name.log.events.tobytes()
    assert by_function.log.header.uavs[0].policy == 'collect_below'


def test_policies_are_compared_over_the_same_missions() -> None:
    evaluation = uav_collect.evaluate('paper_8x8', ['sweep', collect_below], missions=3, seed=5)
    assert {name: [it.mission_seed for it in row] for name, row in evaluation.metrics.items()} == {
        'sweep': [5, 6, 7],
        'collect_below': [5, 6, 7],
    }
    time_s = [mission.completion_s for mission in evaluation.metrics['sweep']]
    estimate = evaluation.estimates['sweep']['completion_s']
    assert estimate.mean == pytest.approx(sum(time_s) / 3)
    assert estimate.low <= estimate.mean <= estimate.high
    more = evaluation.difference('sweep', 'collect_below')['collected_share']
    assert more.mean > 0.0
    assert str(evaluation).startswith('paper_8x8, 2 UAVs, 3 missions from seed 5, exact bandwidth')
    assert 'collect_below' in str(evaluation)


def test_missions_of_an_evaluation_are_those_flown_one_by_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(api, '_AT_ONCE', 2)
    evaluation = uav_collect.evaluate('paper_8x8', 'sweep', missions=3, bandwidth='equal')
    assert evaluation.metrics['sweep'] == [
        uav_collect.fly('paper_8x8', 'sweep', seed=seed, bandwidth='equal').metrics
        for seed in range(3)
    ]


def test_the_last_of_all_missions_is_flown_and_evaluated_alike() -> None:
    flown = uav_collect.fly('paper_8x8', go_home, seed=2**62)
    evaluated = uav_collect.evaluate('paper_8x8', go_home, 1, seed=2**62)
    assert evaluated.metrics['go_home'] == [flown.metrics]
    with pytest.raises(ValueError, match=rf'must be 0\.\.{2**62 - 1}'):
        uav_collect.evaluate('paper_8x8', go_home, 2, seed=2**62)


def test_a_bound_is_beyond_what_is_flown() -> None:
    bound = uav_collect.bound('paper_8x8', seed=3)
    flown = uav_collect.fly('paper_8x8', 'sweep', seed=3).metrics
    assert bound.shortest is not None
    assert bound.shortest.completion_s < flown.completion_s


@pytest.mark.parametrize(
    ('call', 'message'),
    [
        (partial(uav_collect.fly, 'paper_9x9', 'sweep'), "scenario is 'paper_9x9'"),
        (partial(uav_collect.fly, 'paper_8x8', 'swep'), "policy 'swep' is unknown"),
        (
            partial(uav_collect.fly, 'paper_8x8', 7),
            'policy 7: must be a name, a function or a class',
        ),
        (
            partial(uav_collect.fly, 'paper_8x8', 'sweep', bandwidth='most'),
            "allocator 'most' is unknown",
        ),
        (
            partial(uav_collect.bound, 'paper_8x8', bandwidth='most'),
            "allocator 'most' is unknown",
        ),
        (
            partial(uav_collect.evaluate, 'paper_8x8', ['sweep', 'sweep']),
            'policies are sweep, sweep: must be one or more, each once',
        ),
        (partial(uav_collect.evaluate, 'paper_8x8', []), 'policies are none: must be one or'),
    ],
)
def test_what_is_wrong_is_said_in_one_line(call: partial[object], message: str) -> None:
    with pytest.raises(UavCollectError) as caught:
        call()
    assert message in str(caught.value)
    assert '\n' not in str(caught.value)


@pytest.mark.parametrize(
    ('call', 'message'),
    [
        (partial(uav_collect.fly, 'paper_8x8', 'sweep', seed=-1), 'seed is -1: must be 0..'),
        (
            partial(uav_collect.fly, 'paper_8x8', 'sweep', guard_after=-1),
            'guard_after is -1: must be 0..10000',
        ),
        (partial(uav_collect.bound, 'paper_8x8', seed=2**63), r'must be 0\.\.4611686018427387904'),
        (partial(uav_collect.evaluate, 'paper_8x8', 'sweep', 0), 'missions is 0: must be 1..'),
    ],
)
def test_a_number_out_of_range_is_a_value_error(call: partial[object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        call()


def test_the_best_policy_is_found_among_what_is_shipped_and_what_is_given() -> None:
    choice = uav_collect.choose_policy('paper_8x8', [go_home, 'random', 'hert'], missions=4)
    rules = ['sweep', 'hert', 'go_home', 'random']
    names = ['anywhere', *rules]
    assert [it.policy for it in choice.tried] == names
    assert choice.policy == 'anywhere'
    assert str(choice).startswith('anywhere is the best of 5 in 4 sampled missions')
    assert uav_collect.choose_policy('paper_8x8', go_home, missions=4).policy == choice.policy


def test_what_was_refined_for_a_scenario_is_chosen_from_beside_its_file(tmp_path: Path) -> None:
    file = tmp_path / 'field.yaml'
    file.write_text(tiny(name='field').to_yaml())
    own = saved(tmp_path, 'field', header(side=4, n_uavs=2))

    choice = uav_collect.choose_policy(file, missions=2)

    assert [it.policy for it in choice.tried] == [str(own), 'sweep', 'hert']


def test_a_choice_is_refused_a_function_by_the_name_of_another_candidate() -> None:
    def sweep(situation: Situation) -> int:
        return go_home(situation)

    with pytest.raises(UavCollectError, match='policy sweep is a candidate already'):
        uav_collect.choose_policy('paper_8x8', sweep, missions=1)


def test_a_choice_is_refused_what_cannot_be_flown() -> None:
    with pytest.raises(ValueError, match='missions is 0'):
        uav_collect.choose_policy('paper_8x8', missions=0)
    with pytest.raises(UavCollectError, match='fair'):
        uav_collect.choose_policy('paper_8x8', bandwidth='fair', missions=1)
    with pytest.raises(UavCollectError, match='chosen before take-off'):
        uav_collect.fly('paper_8x8', 'best')
