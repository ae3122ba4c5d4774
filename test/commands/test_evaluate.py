"""The command evaluate, against the rollout it stands on."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
import csv
import json
from pathlib import Path
import re

import numpy as np
import pytest
from random_policies import header as header_of_policy
from random_policies import saved
from tiny_world import tiny
from uav_collect.__main__ import main
from uav_collect.analysis.choosing import candidates_for, choose
from uav_collect.analysis.metrics import mission_metrics
from uav_collect.analysis.plan_shares import time_share
from uav_collect.commands import terminal
from uav_collect.missions import rollout
from uav_collect.planning.bound import bound_of
from uav_collect.recording.mission_log import MissionLog
from uav_collect.scenario.load import fingerprint, load, with_uavs
from uav_collect.scenario.model import Scenario
from uav_collect.scenario.site import build_site, Site

MEASURES = (
    'efficiency_kbit_per_j',
    'completion_s',
    'energy_kj',
    'collected_share',
    'complete_share',
    'safe_share',
)


SMALL = ['--scenario', 'paper_8x8', '--missions', '12', '--seed', '5']


FEW = ('--scenario', 'paper_8x8', '--missions', '6', '--seed', '5')


@pytest.fixture(scope='module')
def small() -> Scenario:
    return load('paper_8x8')


def evaluate(*arguments: str) -> int:
    return main(['evaluate', *arguments])


def test_evaluate_writes_the_means_of_the_missions_it_flew(
    tmp_path: Path, small: Scenario
) -> None:
    path = tmp_path / 'figures.json'
    assert evaluate(*SMALL, '--policy', 'hert', '--json', str(path)) == 0
    written = json.loads(path.read_text())['hert']
    logs = rollout.fly(build_site(small), range(5, 17), 'hert', 'exact')
    flown = [mission_metrics(log) for log in logs]
    assert written['completion_s']['mean'] == pytest.approx(
        np.mean([one.completion_s for one in flown]), rel=1e-12
    )
    assert written['energy_kj']['mean'] == pytest.approx(
        np.mean([one.energy_j for one in flown]) / 1e3, rel=1e-12
    )
    for key in MEASURES:
        estimate = written[key]
        assert set(estimate) == {'mean', 'low', 'high'}
        assert estimate['low'] <= estimate['mean'] <= estimate['high']


def test_the_json_says_what_was_flown(tmp_path: Path, small: Scenario) -> None:
    path = tmp_path / 'figures.json'
    options_ = ['--policy', 'hert', 'sweep', '--bandwidth', 'equal', '--json', str(path)]
    assert evaluate(*SMALL, *options_) == 0
    written = json.loads(path.read_text())
    assert list(written) == ['hert', 'sweep']
    for entry in written.values():
        assert entry['scenario'] == 'paper_8x8'
        assert entry['fingerprint'] == fingerprint(small)
        assert (entry['seed'], entry['missions'], entry['bandwidth']) == (5, 12, 'equal')
        assert [uav['id'] for uav in entry['uavs']] == [1, 2]
        energy_kj = sum(uav['energy_kj'] for uav in entry['uavs'])
        assert energy_kj == pytest.approx(entry['energy_kj']['mean'], rel=1e-9)


def test_several_bandwidths_are_flown_one_beside_the_other(tmp_path: Path) -> None:
    both, one = tmp_path / 'both.json', tmp_path / 'one.json'
    base = [*SMALL, '--policy', 'hert', 'sweep']
    assert evaluate(*base, '--bandwidth', 'equal', 'exact', '--json', str(both)) == 0
    assert evaluate(*base, '--bandwidth', 'equal', '--json', str(one)) == 0
    written, alone = json.loads(both.read_text()), json.loads(one.read_text())
    assert [*written] == ['hert, equal', 'hert, exact', 'sweep, equal', 'sweep, exact']
    assert written['hert, equal'] == alone['hert']
    assert (written['hert, exact']['policy'], written['hert, exact']['bandwidth']) == (
        'hert',
        'exact',
    )
    assert written['hert, exact']['completion_s'] != written['hert, equal']['completion_s']


def test_compare_subtracts_each_other_policy_from_the_first_mission_by_mission(
    tmp_path: Path, small: Scenario, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / 'figures.json'
    policies = ['--policy', 'sweep', 'hert', 'hert-equal', '--bandwidth', 'equal', 'exact']
    assert evaluate(*SMALL, *policies, '--compare', '--json', str(path)) == 0
    written = json.loads(path.read_text())
    assert [name for name in written if 'minus' in written[name]] == [
        'sweep, equal',
        'sweep, exact',
    ]
    assert [*written['sweep, equal']['minus']] == ['hert, equal', 'hert-equal, equal']
    found = written['sweep, exact']['minus']['hert, exact']
    assert set(found) == set(MEASURES)
    sweep, hert = (
        np.array([mission_metrics(log).completion_s for log in logs])
        for logs in (
            rollout.fly(build_site(small), range(5, 17), policy, 'exact')
            for policy in ('sweep', 'hert')
        )
    )
    difference = found['completion_s']
    assert difference['mean'] == pytest.approx((sweep - hert).mean(), rel=1e-12)
    assert difference['low'] <= difference['mean'] <= difference['high'] < 0.0
    assert 'sweep, exact minus each other policy' in capsys.readouterr().out


def test_a_learned_policy_is_evaluated_by_its_file(tmp_path: Path) -> None:
    of = header_of_policy(side=8)
    path, output = saved(tmp_path, 'mine', of), tmp_path / 'figures.json'
    budget = ['--set', 'fleet.default.energy_budget_kj=50']
    options_ = [*SMALL, *budget, '--policy', 'hert', str(path), '--json', str(output)]
    assert evaluate(*options_) == 0
    written = json.loads(output.read_text())
    assert [*written] == ['hert', 'mine']
    assert (written['hert']['version'], written['mine']['version']) == ('rule', of.version)
    assert written['mine']['complete_share']['mean'] < 1.0


def test_two_files_of_one_name_are_distinguished_by_their_paths(tmp_path: Path) -> None:
    paths = []
    for seed, folder in enumerate((tmp_path / 'a', tmp_path / 'b')):
        folder.mkdir()
        paths.append(str(saved(folder, 'policy', header_of_policy(side=8), seed)))
    output = tmp_path / 'figures.json'
    budget = ['--set', 'fleet.default.energy_budget_kj=30']
    assert evaluate(*SMALL, *budget, '--policy', *paths, '--json', str(output)) == 0
    assert [*json.loads(output.read_text())] == paths


def test_a_learned_policy_that_does_not_fit_is_refused_before_anything_flies(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = saved(tmp_path, 'mine', header_of_policy(side=10))
    assert evaluate(*SMALL, '--policy', 'hert', str(path)) == 2
    shown = capsys.readouterr()
    assert shown.err == 'error: policy mine: area is 8 x 8 cells: must have 10 rows and columns\n'
    assert shown.out == ''


def test_the_csv_has_one_row_per_mission_and_policy(tmp_path: Path) -> None:
    path = tmp_path / 'missions.csv'
    assert evaluate(*SMALL, '--policy', 'hert', 'sweep', '--csv', str(path)) == 0
    with path.open(newline='') as file:
        rows = list(csv.DictReader(file))
    assert [int(row['mission_seed']) for row in rows] == [*range(5, 17)] * 2
    assert [row['policy'] for row in rows] == ['hert'] * 12 + ['sweep'] * 12
    first, last = rows[0], rows[12]
    assert first['total_mbit'] == last['total_mbit']  # the same missions for each policy
    assert first['completion_s'] != last['completion_s']
    efficiency = float(first['collected_mbit']) / float(first['energy_kj'])
    assert float(first['efficiency_kbit_per_j']) == pytest.approx(efficiency, rel=1e-12)
    energies_kj = [float(first[f'uav_{uav}_energy_kj']) for uav in (1, 2)]
    assert sum(energies_kj) == pytest.approx(float(first['energy_kj']), rel=1e-12)
    landed_s = [float(first[f'uav_{uav}_landed_s']) for uav in (1, 2)]
    assert max(landed_s) == float(first['completion_s'])


def test_a_mission_does_not_depend_on_how_many_are_flown(tmp_path: Path) -> None:
    few, many = tmp_path / 'few.csv', tmp_path / 'many.csv'
    base = ['--scenario', 'paper_8x8', '--policy', 'sweep']
    assert evaluate(*base, '--missions', '3', '--seed', '9', '--csv', str(few)) == 0
    assert evaluate(*base, '--missions', '60', '--seed', '0', '--csv', str(many)) == 0
    assert few.read_text().splitlines()[1:] == many.read_text().splitlines()[10:13]


def test_the_table_shows_every_policy_and_measure(capsys: pytest.CaptureFixture[str]) -> None:
    assert evaluate(*SMALL, '--policy', 'hert', 'sweep') == 0
    shown = capsys.readouterr().out
    for words in (
        'hert',
        'sweep',
        'kbit/J',
        'completion time [s]',
        'energy [kJ]',
        '95 % interval',
    ):
        assert words in shown


def test_set_and_uavs_change_the_scenario(tmp_path: Path, small: Scenario) -> None:
    path = tmp_path / 'figures.json'
    changes = ['--set', 'demand.cell_share=0.6', 'radio.csi_error_variance=0.01', '--uavs', '3']
    assert evaluate(*SMALL, *changes, '--json', str(path)) == 0
    changed = load('paper_8x8', {'demand.cell_share': 0.6, 'radio.csi_error_variance': 0.01})
    changed = with_uavs(changed, 3)
    assert [one.speed_mps for one in changed.uavs] == [5.0, 10.0, 5.0]
    assert json.loads(path.read_text())['sweep']['fingerprint'] == fingerprint(changed)


def test_ctrl_c_shows_and_writes_what_was_flown(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    calls = iter(range(100))
    whole = rollout.fly

    def fly_some(
        site: Site, seeds: Sequence[int], policy: Callable, allocator: str, guard_after: int
    ) -> list[MissionLog]:
        if next(calls) == 3:  # the second policy's second turn
            raise KeyboardInterrupt
        return whole(site, seeds, policy, allocator, guard_after)

    monkeypatch.setattr(rollout, 'fly', fly_some)
    arguments = ['--missions', '120', '--policy', 'hert', 'sweep']
    figures, table = tmp_path / 'figures.json', tmp_path / 'table.csv'
    written = ['--json', str(figures), '--csv', str(table)]
    assert evaluate('--scenario', 'paper_8x8', *arguments, *written) == 130
    shown = capsys.readouterr().out
    assert 'interrupted after 50 of 120 missions' in shown
    assert '50 missions from seed 0' in shown
    assert [of['missions'] for of in json.loads(figures.read_text()).values()] == [50, 50]
    seeds = [int(row['mission_seed']) for row in csv.DictReader(table.read_text().splitlines())]
    assert seeds == [*range(50)] * 2


def test_ctrl_c_before_every_policy_has_flown_writes_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def fly_none(*_: object) -> list[MissionLog]:
        raise KeyboardInterrupt

    monkeypatch.setattr(rollout, 'fly', fly_none)
    arguments = ['--missions', '120', '--json', str(tmp_path / 'figures.json')]
    assert evaluate('--scenario', 'paper_8x8', *arguments) == 130
    assert 'interrupted after 0 of 120 missions' in capsys.readouterr().out
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ('arguments', 'words'),
    [
        (['--scenario', 'atlantis'], ["'atlantis'", 'paper_10x10']),
        (['--scenario', 'atlantis.yaml'], ['atlantis.yaml', 'cannot be read']),
        (['--policy', 'wander'], ["'wander'", 'hert', 'sweep']),
        (['--policy', 'hert', 'hert'], ['hert hert', 'twice']),
        (['--policy', 'nowhere.safetensors'], ['nowhere.safetensors', 'cannot be read']),
        (['--bandwidth', 'equal', 'equal'], ['equal equal', 'twice']),
        (['--compare'], ['--compare', 'two policies or more']),
        (['--set', 'demand.cell_share=2'], ['demand.cell_share is 2', 'to 1']),
        (['--set', 'demand.cell_share'], ['demand.cell_share', 'KEY=VALUE']),
        (['--set', 'demand.nonsense=1'], ['demand.nonsense', 'unknown']),
        (['--json', '/nowhere/at/all.json'], ['/nowhere/at/all.json', 'No such file']),
        (['--csv', '/'], ['/', 'folder']),
        (['--csv', '/tmp/./both', '--json', '/tmp/both'], ['/tmp/both', 'given for two files']),
    ],
)
def test_what_cannot_be_evaluated_is_said_in_one_line(
    arguments: list[str], words: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert evaluate('--missions', '1', *arguments) == 2
    shown = capsys.readouterr()
    assert shown.out == ''
    assert shown.err.count('\n') == 1
    assert shown.err.startswith('error: ')
    assert all(word in shown.err for word in words)


@pytest.mark.parametrize(
    ('arguments', 'words'),
    [
        (['--missions', '0'], ['--missions', "'0'", 'from 1 to']),
        (['--missions', 'many'], ['--missions', "'many'", 'whole number']),
        (['--seed', '-1'], ['--seed', 'from 0 to']),
        (['--uavs', '65'], ['--uavs', 'from 1 to 64']),
        (['--bandwidth', 'all'], ['--bandwidth', 'exact', 'equal', 'cvxpy']),
        (['--speed', '3'], ['--speed']),
        (['--json'], ['--json']),
    ],
)
def test_a_wrong_argument_is_named_in_one_line(
    arguments: list[str], words: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as raised:
        evaluate(*arguments)
    assert raised.value.code == 2
    shown = capsys.readouterr().err
    assert shown.count('\n') == 1
    assert all(word in shown for word in words)


def test_it_says_in_one_line_when_a_policy_flies_outside_what_it_learned_on(
    capsys: pytest.CaptureFixture[str],
) -> None:
    base = [
        '--scenario',
        'paper_10x10',
        '--missions',
        '1',
        '--policy',
        'paper_10x10_n2_aqmix',
        'sweep',
    ]
    assert evaluate(*base) == 0
    assert 'outside' not in capsys.readouterr().err
    assert evaluate(*base, '--set', 'radio.contact_range_m=0') == 0
    shown = capsys.readouterr().err.splitlines()
    assert [line for line in shown if 'outside' in line] == [
        'policy paper_10x10_n2_aqmix flies outside what it learned on: contact range 0 m'
        ' (learned: 200 m)'
    ]


def test_a_full_disk_is_said_in_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    base = ['--scenario', 'paper_8x8', '--missions', '1']
    assert evaluate(*base, '--json', '/dev/full') == 2
    assert capsys.readouterr().err.endswith('error: /dev/full: No space left on device\n')


def watched_bar(monkeypatch: pytest.MonkeyPatch) -> list[object]:
    """What a bar of progress is for: its noun and total, and how far it came."""
    seen: list[object] = []

    @contextmanager
    def bar(total: int, noun: str) -> Iterator[Callable[[int], None]]:
        n_done: list[int] = []
        yield n_done.append
        seen.extend([(noun, total), sum(n_done)])

    monkeypatch.setattr(terminal, 'progress_bar', bar)
    return seen


@pytest.mark.usefixtures('bound_cache')
def test_evaluate_shows_how_near_policies_come_to_the_plans(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    files = tmp_path / 'figures.json', tmp_path / 'missions.csv'
    written = ['--json', str(files[0]), '--csv', str(files[1])]
    policies = ['--policy', 'sweep', 'hert', '--bandwidth', 'equal']
    bar = watched_bar(monkeypatch)
    assert main(['evaluate', *FEW, *policies, '--bound', *written]) == 0
    assert '% of the clairvoyant plan' in capsys.readouterr().out
    assert bar == [('missions and plans', 18), 18]
    document = json.loads(files[0].read_text())
    site = build_site(load('paper_8x8'))
    logs = rollout.fly(site, range(5, 11), 'hert', 'equal')
    reached = [
        time_share(mission_metrics(log), bound_of(site, log.header.mission_seed, 'equal'))
        for log in logs
    ]
    assert document['hert']['bound']['missions'] == 6
    assert document['hert']['bound']['time_share']['mean'] == pytest.approx(np.mean(reached))
    with files[1].open(newline='') as lines:
        rows = [row for row in csv.DictReader(lines) if row['policy'] == 'hert']
    assert [float(row['time_share']) for row in rows] == pytest.approx(reached)


@pytest.mark.usefixtures('bound_cache')
def test_evaluate_leaves_the_bound_out_unless_it_is_asked_for(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / 'missions.csv'
    assert main(['evaluate', *FEW, '--policy', 'hert', '--csv', str(file)]) == 0
    assert 'clairvoyant' not in capsys.readouterr().out
    assert 'time_share' not in file.read_text()


def without_seconds(table: str) -> str:
    """A table of candidates without what it took to try them."""
    return re.sub(r' +[0-9.]+ s$', '', table, flags=re.MULTILINE)


def test_the_best_policy_is_chosen_and_shown_before_it_is_evaluated(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / 'figures.json'
    words = [*FEW, '--policy', 'best', 'hert', '--candidates', 'random', '--json', str(path)]
    assert evaluate(*words) == 0
    scenario = load('paper_8x8')
    choice = choose(build_site(scenario), candidates_for(scenario, ['random'])[0])
    assert without_seconds(capsys.readouterr().out).startswith(without_seconds(f'{choice}\n'))
    written = json.loads(path.read_text())
    assert [*written] == [choice.policy, 'hert'] == ['anywhere', 'hert']


def test_the_best_policy_flies_once_where_it_is_also_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, file = tmp_path / 'figures.json', tmp_path / 'field.yaml'
    file.write_text(tiny(name='field').to_yaml())
    words = ['--scenario', str(file), '--missions', '2', '--json', str(path), '--compare']
    assert evaluate(*words, '--policy', 'hert', 'best', 'sweep') == 0
    assert [*json.loads(path.read_text())] == ['hert', 'best (sweep)']
    assert '\n4 missions flown in ' in capsys.readouterr().out


def test_what_was_refined_for_a_scenario_is_chosen_from_beside_its_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / 'field.yaml'
    file.write_text(tiny(name='field').to_yaml())
    saved(tmp_path, 'field', header_of_policy(side=4, n_uavs=2))
    assert evaluate('--scenario', str(file), '--missions', '2', '--policy', 'best') == 0
    assert 'is the best of 3 in' in capsys.readouterr().out


def test_candidates_are_for_the_best_policy_alone(capsys: pytest.CaptureFixture[str]) -> None:
    assert evaluate(*FEW, '--policy', 'hert', '--candidates', 'random') == 2
    assert '--candidates: must come with --policy best' in capsys.readouterr().err
