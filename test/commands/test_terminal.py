"""What commands show while they work: a picture that moves in a terminal, lines in a file."""

from pathlib import Path
import re
import sys

from processes import DEADLINE_S, Processes
import pytest
from terminal import Ear, in_terminal, on_screen, pictures
from tiny_world import tiny
from uav_collect import HOME, Situation
from uav_collect.__main__ import main
from uav_collect.missions.rollout import fly
from uav_collect.recording.mission_log import read
from uav_collect.scenario.site import build_site
import user_policies

pytest.importorskip('torch', reason='training needs torch')

BAR = '[━╸╺]{40}'
FEW = """extends: smoke
tests: {missions: 2, missions_per_job: 1, plan_rounds: 1}
"""


@pytest.fixture
def field(tmp_path: Path) -> str:
    path = tmp_path / 'field.yaml'
    path.write_text(tiny(name='field').to_yaml())
    return str(path)


def shown(processes: Processes, command: str, *arguments: str) -> str:
    """All that a command writes to the terminal that it is started in."""
    words = (sys.executable, '-m', 'uav_collect', command, *arguments)
    process = in_terminal(processes, command, *words, UAV_COLLECT_KERNELS='interpreted')
    assert process.wait_for_exit() == 0, process.output
    return process.output


def has(picture: str, *lines: str) -> bool:
    """Whether lines, as regular expressions, stand one below the other."""
    below = '\n'.join(f'{line} *' for line in lines)
    return re.search(f'^{below}$', picture, re.MULTILINE) is not None


_FOLLOW = """
from pathlib import Path
import sys
from types import SimpleNamespace
from uav_collect.commands import mission
polls = iter([None, None, 0])
world = SimpleNamespace(popen=SimpleNamespace(poll=lambda: next(polls)))
mission._follow(SimpleNamespace(check=lambda but: None), world, Path(sys.argv[1]))
print('landed')
"""


def test_the_progress_of_a_mission_is_gone_when_it_has_landed(
    processes: Processes, tmp_path: Path
) -> None:
    [log] = fly(build_site(tiny()), [0], 'sweep')
    (tmp_path / 'mission.jsonl').write_bytes(log.to_jsonl())
    command = (sys.executable, '-c', _FOLLOW, str(tmp_path / 'mission.jsonl'))
    process = in_terminal(processes, 'follow', *command)
    assert process.wait_for_exit() == 0, process.output
    *_, last = pictures(process.output)
    assert has(last, f'flying {BAR} 100% of the data, .* s simulated'), last
    assert on_screen(process.output) == 'landed'


def test_a_training_is_a_picture_that_is_gone_when_it_ends(
    processes: Processes, settings: list[str], tmp_path: Path
) -> None:
    output = shown(processes, 'train', *settings, '--output', str(tmp_path / 'run'))
    *_, last = pictures(output)
    assert has(
        last,
        f'run  {BAR}',
        r'  100%   [\d,]+ decisions/s   \d+\.\d updates/s   loss \S+',
        r'  \d\.\d{3} kbit/J exploring   \d\.\d{3}.* validated   \d\.\d{3}.* best',
        r'  \d+ missions   1,200 decisions   \d+ updates   replay [\d,]+ \(1 MB\)',
    ), last
    left = on_screen(output)
    assert re.search(f'{BAR}|decisions/s|exploring', left) is None
    policy, curve = (tmp_path / 'run' / file for file in ('policy.safetensors', 'curve.png'))
    assert left.endswith(f'\npolicy: {policy}\ncurve:  {curve}')


def test_jobs_of_studies_are_a_picture_that_is_gone_when_they_are_done(
    processes: Processes, tmp_path: Path
) -> None:
    (tmp_path / 'mine.yaml').write_text(FEW)
    options = ('--scale', str(tmp_path / 'mine.yaml'), '--only', 'csi', '--workers', '1')
    output = shown(processes, 'figures', *options, '--output', str(tmp_path / 'o'))
    counts, job = r'  \d+ of 21 jobs done, 1 running', r' +\d+%  (train|fly|plan) .*'
    assert any(has(picture, f'scale mine  {BAR}', counts, job) for picture in pictures(output))
    left = on_screen(output)
    assert re.search(f'{BAR}|jobs done', left) is None
    figure, results = (tmp_path / 'o' / 'mine' / file for file in ('csi.png', 'results.md'))
    assert left.endswith(f'\n{figure}\n{results}')


def test_missions_that_are_evaluated_are_a_bar_that_is_gone_when_they_are_flown(
    processes: Processes, field: str
) -> None:
    options = ('--scenario', field, '--missions', '40', '--policy', 'sweep')
    output = shown(processes, 'evaluate', *options)
    seen = pictures(output)
    assert any(has(picture, f'missions {BAR}  0/40') for picture in seen), seen
    assert has(seen[-1], f'missions {BAR} 40/40'), seen
    assert re.search(f'{BAR}|/40', on_screen(output)) is None


def test_missions_that_are_evaluated_are_lines_where_there_is_no_terminal(
    field: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    ear = Ear('0 of 1 missions')

    def patient(situation: Situation) -> int:
        assert ear.heard.wait(DEADLINE_S)
        return HOME

    monkeypatch.setattr(user_policies, 'slow', patient)
    monkeypatch.setattr(sys, 'stderr', ear)
    options = ('--missions', '1', '--policy', 'user_policies:slow')
    assert main(['evaluate', '--scenario', field, *options]) == 0
    assert has(ear.getvalue(), r'0 of 1 missions, \d+ s so far')


@pytest.mark.ros
def test_a_mission_is_a_bar_that_goes_when_all_have_landed(
    processes: Processes, field: str, tmp_path: Path
) -> None:
    options = ('--scenario', field, '--policy', 'sweep', '--output', str(tmp_path / 'run'))
    output = shown(processes, 'mission', *options)
    seen = pictures(output)
    n_events = len(read(tmp_path / 'run' / 'mission_0.jsonl').events)
    flown = rf'flying {BAR} 100% of the data, {n_events} events, \d+ s simulated'
    for shown_once in (f'starting {BAR}', flown):
        assert any(has(picture, shown_once) for picture in seen), seen
    title, left = 'field, seed 0, 2 UAVs: sweep', on_screen(output)
    assert has(left, title, r'flown in [\d.]+ s'), left
    assert not re.findall(BAR, left)
