"""Policies that users name as module:function fly everywhere alike, and fail in one line."""

import functools
import json
import os
from pathlib import Path
import shutil
import sys

from fleets import Fleet, logs, scenario_of
import hostile_policies
from interpreted import interpreted
from processes import complaints, completed, hear_signals, Processes
import pytest
from tiny_world import tiny
from uav_collect import api
from uav_collect.__main__ import main
from uav_collect.analysis.metrics import check_log, mission_metrics
from uav_collect.errors import PolicyMismatchError
from uav_collect.limits import is_code_name
from uav_collect.missions.rollout import fly
from uav_collect.recording.mission_log import MissionLog
from uav_collect.scenario.model import Scenario
from uav_collect.scenario.site import build_site
from uav_collect.uav.policy import policy_for
from uav_collect.uav.user_policy import user_policy

SEEDS = [3, 4]
ROOT = Path(__file__).parents[2]
HELPERS = ROOT / 'test' / 'helpers'


def flown(policy: str, scenario: Scenario | None = None) -> list[MissionLog]:
    scenario = scenario or scenario_of(2, fleet__default__energy_budget_kj=60.0)
    return fly(build_site(scenario), SEEDS, policy)


def failure(policy: str, scenario: Scenario | None = None) -> str:
    """The one line that a mission of the policy ends with."""
    with pytest.raises(PolicyMismatchError) as raised:
        flown(policy, scenario)
    text = str(raised.value)
    assert '\n' not in text
    assert text.startswith(f'policy {policy}: ')
    return text


def logs_of_all() -> str:
    names = ('nearest', 'Wanderer')
    return ''.join(
        log.to_jsonl().decode() for name in names for log in flown(f'user_policies:{name}')
    )


def kinds_of_rows() -> str:
    return failure('user_policies:kinds')


# Flying.


def test_a_function_flies_a_mission_and_stands_in_its_log() -> None:
    for log in flown('user_policies:nearest'):
        check_log(log)
        assert mission_metrics(log).is_complete
        assert {uav.policy for uav in log.header.uavs} == {'user_policies:nearest'}


def test_a_mission_of_a_function_or_class_is_the_same_compiled_and_interpreted() -> None:
    assert logs_of_all() == interpreted(logs_of_all)


def test_what_a_function_gets_has_the_same_types_compiled_and_interpreted() -> None:
    kinds = kinds_of_rows()
    assert kinds == interpreted(kinds_of_rows)
    # The map, where no sensor is below, and what is legal.
    for kind in ('uint8(100,)', 'int64(0,)', 'float64(0,)', 'int64(5,)'):
        assert kind in kinds


def test_a_class_remembers_for_one_uav_and_one_mission() -> None:
    name = 'user_policies:Wanderer'
    scenario = scenario_of(3, fleet__default__energy_budget_kj=20.0)
    together = fly(build_site(scenario), [0, 1], name)
    [alone] = fly(build_site(scenario), [1], name)
    assert together[1].to_jsonl() == alone.to_jsonl()
    # Hover, north and east are legal in the corner; counts begin with the UAV's index.
    firsts = alone.events[alone.events['decision'] == 0]
    assert firsts['action'].tolist() == [1, 2, 0]


def test_a_function_that_writes_over_what_it_gets_changes_nothing() -> None:
    tidy, untidy = flown('user_policies:nearest'), flown('user_policies:scribbler')
    assert [log.events.tobytes() for log in tidy] == [log.events.tobytes() for log in untidy]


def test_a_function_may_send_its_uav_home() -> None:
    for log in flown('user_policies:homebird'):
        assert len(log.events) == 2
        assert mission_metrics(log).is_finished


def test_evaluate_flies_functions_beside_other_policies(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, name = tmp_path / 'figures.json', 'user_policies:nearest'
    options = ['--missions', '2', '--seed', '3', '--compare', '--json', str(path)]
    assert main(['evaluate', '--policy', name, 'sweep', *options]) == 0
    assert name in capsys.readouterr().out
    written = json.loads(path.read_text())[name]
    assert written['policy'] == name
    times_s = [mission_metrics(log).completion_s for log in flown(name, scenario_of(2))]
    assert written['completion_s']['mean'] == pytest.approx(sum(times_s) / 2, rel=1e-12)
    assert set(written['minus']) == {'sweep'}


def test_a_module_lies_in_the_working_directory_and_its_text_is_the_version(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, 'path', [path for path in sys.path if path])
    versions = []
    for text in ('def go(s):\n    return 5\n', 'def go(s):\n    return 1\n'):
        Path('my_own_policies.py').write_text(text)
        monkeypatch.delitem(sys.modules, 'my_own_policies', raising=False)
        versions.append(user_policy('my_own_policies:go').version)
    assert len({*versions}) == 2
    assert all(len(version) == 12 for version in versions)


# Failing.


@pytest.mark.parametrize(
    ('name', 'words'),
    [
        ('nowhere_at_all:go', 'there is no module nowhere_at_all in /'),
        ('user_policies.deep:go', 'there is no module user_policies.deep in /'),
        ('user_policies:missing', 'module user_policies has no missing'),
        ('user_policies:NUMBER', 'NUMBER is a int: must be a function'),
        ('user_policies:Stillborn', 'UAV 1, at the start: OSError: no memory for UAV 0 (user_'),
        ('user_policies:Speechless', 'a Speechless cannot be called'),
    ],
)
def test_what_cannot_fly_is_refused_before_anything_flies(name: str, words: str) -> None:
    with pytest.raises(PolicyMismatchError) as raised:
        policy_for(name, tiny())
    assert str(raised.value).startswith(f'policy {name}: {words}')


@pytest.mark.parametrize(
    ('text', 'words'),
    [
        ('1 / 0', 'ZeroDivisionError: division by zero'),
        ('import nothing_like_it', "ModuleNotFoundError: No module named 'nothing_like_it'"),
        ('\nraise SystemExit(3)', 'SystemExit: 3 (my_broken_policies.py, line 2)'),
        ('raise KeyboardInterrupt', 'KeyboardInterrupt (my_broken_policies.py, line 1)'),
        ('def (', 'SyntaxError: invalid syntax (my_broken_policies.py, line 1)'),
        ('import sys; sys.modules[__name__] = 7', 'module my_broken_policies is a'),
    ],
)
def test_a_module_that_fails_is_refused_with_its_reason(
    text: str, words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / 'my_broken_policies.py').write_text(text)
    monkeypatch.delitem(sys.modules, 'my_broken_policies', raising=False)
    with pytest.raises(PolicyMismatchError) as raised:
        user_policy('my_broken_policies:go')
    text = str(raised.value)
    start = 'policy my_broken_policies:go: '
    assert (
        text.removeprefix(start)
        .removeprefix('module my_broken_policies cannot be imported: ')
        .startswith(words)
    )
    assert text.startswith(start)


@pytest.mark.parametrize(
    ('name', 'words'),
    [
        ('westward', 'UAV 1 at 0.0 s in cell 0: 4 is no legal action; legal are [1, 2] and 5 to'),
        ('by_name', "UAV 1 at 0.0 s in cell 0: 'north' is no legal action; legal are [1, 2]"),
        (
            'divider',
            'UAV 1 at 0.0 s in cell 0: ZeroDivisionError: division by zero (user',
        ),
        (
            'greedy_for_arguments',
            'UAV 1 at 0.0 s in cell 0: TypeError: greedy_for_arguments() ',
        ),
        ('script', 'UAV 1 at 0.0 s in cell 0: TypeError: script() takes 0 positional arguments'),
        ('late', 'RuntimeError: the wind is too strong (user_policies.py, line '),
    ],
)
def test_a_failure_in_flight_names_uav_time_place_and_line(name: str, words: str) -> None:
    assert words in failure(f'user_policies:{name}', tiny())


def line_of(name: str) -> int:
    """Where a hostile policy goes wrong."""
    lines = (HELPERS / 'hostile_policies.py').read_text().splitlines()
    [number] = [at for at, line in enumerate(lines, 1) if line.endswith(f'# line: {name}')]
    return number


@pytest.mark.parametrize(
    ('name', 'words'),
    [
        ('leaves', 'SystemExit: 7'),
        ('exits_deeper', 'SystemExit: 7'),
        ('interrupts', 'KeyboardInterrupt'),
        ('throws', 'KeyboardInterrupt'),
        ('closes_generator', 'GeneratorExit'),
        ('groups', 'BaseExceptionGroup: all (2 sub-exceptions)'),
        ('recurses', 'RecursionError: maximum recursion depth exceeded'),
        ('runs_out', 'MemoryError'),
        ('is_silent', 'SilentError'),
        ('is_nameless', 'NamelessError: anonymous'),
        ('talks', r'ValueError: \x1b[31m line [bold]xxx'),
        ('fails_in_numpy', 'LinAlgError: Singular matrix'),
        ('decorated', 'ValueError: within'),
        ('index', 'ValueError: no index'),
        ('lies', '<hostile_policies.Liar object at 0x'),
        ('no_repr', 'a NoRepr without a repr is no legal action'),
        ('number', '77 is no legal action'),
        ('true', 'True is no legal action'),
        ('numpy_true', 'True_ is no legal action'),
        ('fraction', 'nan is no legal action'),
        ('huge', '1000000000000000000000000000000 is no legal action'),
        ('negative', '-1 is no legal action'),
        ('row', 'array([0., 0., 0., ..., 0., 0., 0.]'),
        ('asynchronous', '<coroutine object asynchronous at 0x'),
        ('yields', '<generator object yields at 0x'),
        ('yields_later', '<async_generator object yields_later at 0x'),
        ('nothing', 'None is no legal action'),
        ('FailsToCall', 'SystemExit: in a class'),
    ],
)
def test_whatever_a_function_does_is_one_line_of_it(name: str, words: str) -> None:
    text = failure(f'hostile_policies:{name}', tiny())
    where = f'policy hostile_policies:{name}: UAV 1 at 0.0 s in cell 0: '
    assert text.startswith(where)
    assert words in text.removeprefix(where)
    assert text.endswith(f' (hostile_policies.py, line {line_of(name)})')
    assert len(text) < 400
    assert text.isprintable()


def test_a_class_that_ends_the_program_is_refused_before_anything_flies() -> None:
    with pytest.raises(PolicyMismatchError) as raised:
        policy_for('hostile_policies:FailsToBegin', tiny())
    line = (
        f'UAV 1, at the start: SystemExit: 0 (hostile_policies.py, line {line_of("FailsToBegin")})'
    )
    assert str(raised.value) == f'policy hostile_policies:FailsToBegin: {line}'


def test_a_number_of_another_library_is_an_action() -> None:
    for log in flown('hostile_policies:numpy_number'):
        assert len(log.events) == 2


@pytest.mark.parametrize(
    ('name', 'status', 'said'),
    [
        (
            'leaves',
            2,
            'error: policy hostile_policies:leaves: UAV 1 at 0.0 s in cell 0: Sys',
        ),
        (
            'closes_stdout',
            2,
            'UAV 1 at 0.0 s in cell 0: it closes sys.stdout (hostile_',
        ),
        (
            'closes_stderr',
            2,
            'UAV 1 at 0.0 s in cell 0: it closes sys.stderr (hostile_',
        ),
        ('replaces_streams', 0, ''),
        ('asks_to_end', 130, ''),
        ('tidies_up_when_asked_to_end', 130, ''),
    ],
)
def test_the_status_is_the_programs_own(name: str, status: int, said: str) -> None:
    options = ['--missions', '1', '--policy', f'hostile_policies:{name}']
    environment = {'UAV_COLLECT_KERNELS': 'interpreted', 'PYTHONPATH': f'{ROOT}:{HELPERS}'}
    done = completed(
        *(sys.executable, '-m', 'uav_collect', 'evaluate', *options),
        status=status,
        env=os.environ | environment,
        preexec_fn=hear_signals,
    )
    assert said in done.stderr
    lines = complaints(done.stderr)
    assert len(lines) == (1 if said else 0)


@pytest.mark.parametrize(
    ('target', 'words'),
    [
        (7, 'policy 7: must be a name, a function or a class'),
        (hostile_policies.NoRepr(), 'policy a NoRepr without a repr: must be'),
        (hostile_policies.leaves, 'policy leaves: UAV 1 at 0.0 s in cell 0: SystemExit: 7'),
        (functools.partial(hostile_policies.leaves), 'policy partial: UAV 1 at 0.0 s'),
        (eval('lambda situation: 1 / 0', {}), 'policy <lambda>: UAV 1 at 0.0 s in cell 0: Zero'),
    ],
)
def test_python_gets_the_same_line_for_a_function_itself(target: object, words: str) -> None:
    with pytest.raises(PolicyMismatchError) as raised:
        api.fly(tiny(), target)  # type: ignore[arg-type]
    assert str(raised.value).startswith(words)


def test_a_failing_function_ends_evaluate_with_one_line(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(['evaluate', '--policy', 'user_policies:late', '--missions', '1']) == 2
    shown = capsys.readouterr()
    lines = shown.err.splitlines()
    [line] = [line for line in lines if not line.startswith('compiling kernels (once)')]
    assert line.startswith('error: policy user_policies:late: UAV ')


@pytest.mark.parametrize(
    ('name', 'is_one'),
    [
        ('pilots:go', True),
        ('our.pilots:Go', True),
        ('pilots:', False),
        (':go', False),
        ('pilots', False),
        ('pilots:go:on', False),
        ('runs/a:b.safetensors', False),
    ],
)
def test_a_function_is_named_by_its_module_and_its_name(name: str, is_one: bool) -> None:
    assert is_code_name(name) is is_one


# Over ROS.


@pytest.mark.ros
@pytest.mark.parametrize('name', ['nearest', 'Wanderer'])
def test_missions_over_ros_equal_those_flown_in_one_process(
    name: str, processes: Processes, tmp_path: Path
) -> None:
    shutil.copy(HELPERS / 'user_policies.py', tmp_path)  # where the processes run
    scenario = scenario_of(2, fleet__default__energy_budget_kj=60.0)
    fleet = Fleet(processes=processes, scenario=scenario, folder=tmp_path / 'run')
    fleet.start_agents(f'user_policies:{name}')
    world = fleet.start_world(seed=SEEDS[0], missions=len(SEEDS))
    expected = logs(scenario, SEEDS, f'user_policies:{name}')
    assert world.wait_for_exit() == 0
    assert fleet.logs(SEEDS) == expected


@pytest.mark.ros
@pytest.mark.parametrize(
    ('name', 'words'),
    [
        ('user_policies:missing', 'has no missing'),
        ('user_policies:late', r'RuntimeError: the wind is too strong \(user_'),
        ('hostile_policies:leaves', r'UAV 1 at 0.0 s in cell 0: SystemExit: 7 \(hostile_'),
    ],
)
def test_an_agent_whose_function_fails_ends_with_one_line(
    name: str, words: str, processes: Processes, tmp_path: Path
) -> None:
    for module in ('user_policies.py', 'hostile_policies.py'):
        shutil.copy(HELPERS / module, tmp_path)  # where the processes run
    fleet = Fleet(processes=processes, scenario=scenario_of(1), folder=tmp_path / 'run')
    fleet.start_world()
    agent = fleet.start_agent(1, name)
    assert agent.wait_for_exit() == 2
    agent.wait_for(f'policy {name}: .*{words}')
    assert 'Traceback' not in agent.output
