"""How kernels run in a process that flies a small job, and what it says of that."""

import os
from pathlib import Path
import sys

from processes import complaints, completed
import pytest
from uav_collect.kernels import compile as compile_module
from uav_collect.kernels.compile import cache_folder

ASK = """
from uav_collect.missions.small_jobs import choose_kernels
choose_kernels({n_missions}, 100)
from uav_collect.kernels.compile import kernels_are_compiled
print(kernels_are_compiled())
"""
SAID = 'flying with interpreted kernels, as none are compiled yet: the first larger job'


def asked(cache: Path, n_missions: int, before: str = '', switch: str = '') -> tuple[str, str]:
    """What a process prints, whether its kernels are compiled, and says."""
    environment = {**os.environ, 'XDG_CACHE_HOME': str(cache), 'UAV_COLLECT_KERNELS': switch}
    script = before + ASK.format(n_missions=n_missions)
    done = completed(sys.executable, '-c', script, env=environment)
    return done.stdout.strip(), done.stderr.strip()


def test_a_small_job_flies_interpreted_and_says_so(tmp_path: Path) -> None:
    compiled, said = asked(tmp_path, 1_000)
    assert compiled == 'False'
    [line] = complaints(said)
    assert line.startswith(SAID)


def test_a_larger_job_compiles(tmp_path: Path) -> None:
    assert asked(tmp_path, 1_001) == ('True', '')


@pytest.mark.parametrize('switch', ['compiled', 'interpreted'])
def test_what_the_environment_asks_for_stands(tmp_path: Path, switch: str) -> None:
    assert asked(tmp_path, 10, switch=switch) == (str(switch == 'compiled'), '')


@pytest.mark.parametrize('is_here', [True, False])
def test_kernels_that_are_compiled_are_used_unless_by_sources_elsewhere(
    is_here: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv('XDG_CACHE_HOME', str(tmp_path))
    if not is_here:
        monkeypatch.setattr(compile_module, '_PACKAGE', tmp_path / 'clone' / 'uav_collect')
    folder = cache_folder() / 'missions_1'
    folder.mkdir(parents=True)
    (folder / 'batch_kernels.fly_batch-180.py311.nbi').touch()
    assert asked(tmp_path, 10)[0] == str(is_here)


def test_kernels_that_were_imported_stay_as_they_are(tmp_path: Path) -> None:
    before = 'import uav_collect.missions.batch_kernels\n'
    assert asked(tmp_path, 10, before) == ('True', '')


def test_nothing_of_evaluate_and_size_imports_kernels_before_it_is_settled(tmp_path: Path) -> None:
    script = """
import sys
import uav_collect.missions.small_jobs as small_jobs
from uav_collect.__main__ import main
class Settled(Exception): pass
def settle(n_missions, n_cells, policies):
    raise Settled(n_missions, n_cells, 'uav_collect.kernels.arrays' in sys.modules)
small_jobs.choose_kernels = settle
for arguments in (
    ['evaluate', '--policy', 'hert', 'sweep'],
    ['evaluate', '--bound', '--bandwidth', 'equal', 'exact'],
    ['size', '--uavs', '1', '2'],
):
    try:
        main([*arguments, '--missions', '7'])
    except Settled as settled:
        print(*settled.args)
"""
    done = completed(sys.executable, '-c', script, cwd=tmp_path)
    assert done.stdout.splitlines() == ['14 100 False', '294 100 False', '126 100 False']


def test_nothing_that_users_import_settles_it_before_the_api_does(tmp_path: Path) -> None:
    script = """
import sys
import uav_collect.missions.small_jobs as small_jobs
class Settled(Exception): pass
def settle(n_missions, n_cells, policies=()):
    raise Settled(n_missions, n_cells, *policies, 'numba' in sys.modules)
small_jobs.choose_kernels = settle
from uav_collect import HOVER, Situation, bound, choose_policy, evaluate, fly, load, step_towards
def own(situation: Situation) -> int:
    return HOVER
scenario = load('paper_8x8')
for call in (
    lambda: fly(scenario, 'hert'),
    lambda: evaluate('paper_8x8', ['hert', own], missions=7),
    lambda: choose_policy(scenario, ['hert', own], missions=2),
    lambda: bound(scenario),
):
    try:
        call()
    except Settled as settled:
        print(*settled.args)
"""
    done = completed(sys.executable, '-c', script, cwd=tmp_path)
    expected = ['1 64 hert False', '14 64 hert False', '16 64 hert False', '20 64 False']
    assert done.stdout.splitlines() == expected


def test_a_small_job_settles_it_for_its_process_alone_and_what_follows_says_so(
    tmp_path: Path,
) -> None:
    script = """
import os
from uav_collect import fly
print(fly('paper_8x8', 'sweep').metrics.is_complete, repr(os.environ['UAV_COLLECT_KERNELS']))
from uav_collect.missions.small_jobs import choose_kernels
choose_kernels(10_000, 64)
"""
    environment = {**os.environ, 'XDG_CACHE_HOME': str(tmp_path), 'UAV_COLLECT_KERNELS': ''}
    done = completed(sys.executable, '-c', script, env=environment)
    assert done.stdout == "True ''\n"
    small, larger = complaints(done.stderr)
    assert small.startswith(SAID)
    assert larger.startswith(
        'flying with interpreted kernels, as this process began with a small job: one that'
    )


@pytest.mark.parametrize('known', ['sensors', 'none'])
def test_to_load_closed_cells_leaves_open_how_kernels_run(tmp_path: Path, known: str) -> None:
    changed = {
        'area.no_fly': [[[2600.0, 100.0], [2700.0, 100.0], [2700.0, 200.0]]],
        'demand.known_empty': known,
    }
    before = f"""
import sys
from uav_collect.scenario.load import load
load('lillgrund', {changed})
print('numba' in sys.modules)
"""
    assert asked(tmp_path, 10, before)[0].split() == ['False', 'False']


def test_kernels_are_all_compiled_where_loading_a_scenario_took_some(tmp_path: Path) -> None:
    before = 'import uav_collect.kernels.keyed_random\n'
    assert asked(tmp_path, 10, before) == ('True', '')


def test_a_small_job_over_closed_cells_flies_with_nothing_compiled(tmp_path: Path) -> None:
    scenario = tmp_path / 'closed.yaml'
    scenario.write_text(
        'extends: paper_10x10\narea:\n  no_fly: [[[110, 110], [120, 110], [120, 120]]]\n'
    )
    environment = {k: v for k, v in os.environ.items() if k != 'UAV_COLLECT_KERNELS'}
    environment |= {'XDG_CACHE_HOME': str(tmp_path)}
    arguments = ['evaluate', '--scenario', str(scenario), '--policy', 'sweep', '--missions', '1']
    done = completed(sys.executable, '-m', 'uav_collect', *arguments, env=environment)
    [line] = [it for it in complaints(done.stderr) if not it.startswith('0 of 1 missions')]
    assert line.startswith(SAID)
