"""What README.md, CONTRIBUTING.md and docs/ name is there, and what they show works."""

import ast
from collections.abc import Iterator
from contextlib import redirect_stdout
from importlib import import_module
from io import StringIO
import json
import os
from pathlib import Path
import re
import shlex
import signal
import sys
from typing import Any

from bags import HandMadeBag
from documents import all_blocks, blocks, DOCUMENTS, made, name_of, page, ROOT
from interpreted import interpreted
from processes import completed, Processes
import pytest
from uav_collect.__main__ import main
from uav_collect.config.installed import shared_folders
from uav_collect.config.layers import names_in
from uav_collect.missions.rollout import fly
from uav_collect.scenario.load import load, scenario_names
from uav_collect.scenario.site import build_site
from uav_collect.studies.claims.claims import CLAIMS
from uav_collect.studies.scale import load_scale
import yaml

from tools.structure import ORDER, read, Sources

README = (ROOT / 'README.md').read_text()
CONTRIBUTING = (ROOT / 'CONTRIBUTING.md').read_text()
GLOSSARY = page('glossary.md')
OWN_POLICY, OWN_ALGORITHM = page('tutorials/own_policy.md'), page('tutorials/own_algorithm.md')
CODE = '\n'.join(
    path.read_text()
    for folder in ('uav_collect', 'msg_defs', 'setup.py')
    for path in [ROOT / folder, *(ROOT / folder).rglob('*')]
    if path.suffix in ('.py', '.msg', '.srv')
)
PAPER_MAP = page('paper_map.md')


def defined_names(path: Path) -> set[str]:
    """Functions, classes and constants of a source; methods and fields with their class."""
    body = ast.parse(path.read_text()).body
    inside = [(f'{node.name}.', node.body) for node in body if isinstance(node, ast.ClassDef)]
    return {f'{owner}{name}' for owner, part in [('', body), *inside] for name in named_in(part)}


def named_in(body: list[ast.stmt]) -> Iterator[str]:
    for node in body:
        match node:
            case ast.FunctionDef(name=name) | ast.ClassDef(name=name):
                yield name
            case ast.AnnAssign(target=ast.Name(id=name)):
                yield name
            case ast.Assign(targets=targets):
                yield from (it.id for it in targets if isinstance(it, ast.Name))


def names_in_the_glossary() -> Iterator[str]:
    """What the glossary says that words are called in the code."""
    for table in re.findall(r'(?:^\|.*\n)+', GLOSSARY, re.MULTILINE):
        titles, _, *rows = (line.split('|') for line in table.splitlines())
        cells = [dict(zip(titles, row, strict=True)) for row in rows]
        for row in cells:
            yield from re.findall(r'`([^`]+)`', row.get(' name in the code ', ''))


def is_in_the_code(name: str) -> bool:
    """Whether a dotted name is defined there, a plain one occurs, a path is a file."""
    if '/' in name:
        return (ROOT / name).is_file()
    if '.' not in name:
        return re.search(rf'\b{name}\b', CODE) is not None
    parts = name.split('.')
    for length in range(len(parts), 0, -1):
        module = ROOT / 'uav_collect' / '/'.join(parts[:length])
        if length == len(parts) and module.is_dir():
            return True
        if module.with_suffix('.py').is_file():
            rest = '.'.join(parts[length:])
            return not rest or rest in defined_names(module.with_suffix('.py'))
    return False


def is_a_key(path: str) -> bool:
    """Whether a dotted path leads to a value of a scenario."""
    found = load('rough_10x10').as_mapping()  # the one that states every value
    found['fleet']['uavs'] = found['fleet']['uavs'][0]
    for key in path.split('.'):
        if key not in found:
            return False
        found = found[key]
    return True


def anchors(document: Path) -> set[str]:
    """The places of a document that links can lead to: its headings."""
    text = re.sub(r'^```.*?^```', '', document.read_text(), flags=re.MULTILINE | re.DOTALL)
    titles = re.findall(r'^#+ (.*)$', text, re.MULTILINE)
    return {re.sub(r'[^\w -]', '', title.lower()).strip().replace(' ', '-') for title in titles}


@pytest.mark.parametrize('path', DOCUMENTS, ids=name_of)
def test_everything_that_a_document_links_is_there(path: Path) -> None:
    links = re.findall(r'\]\(([^)#\s]*)#?([^)]*)\)', path.read_text())
    local = [(path.parent / file if file else path, at) for file, at in links if ':' not in file]
    assert [str(file) for file, _ in local if not file.exists()] == []
    to_places = [(file, at) for file, at in local if at and file.suffix == '.md']
    assert [(str(file), at) for file, at in to_places if at not in anchors(file)] == []


def test_the_readme_is_read_in_five_minutes() -> None:
    assert len(README.split()) <= 900


def test_every_interval_in_the_readme_is_one_that_was_measured() -> None:
    pattern = r'[\d.]+ \([\d.]+ to [\d.]+\)'
    shown = re.findall(pattern, README.replace(' %', ''))
    measured = re.findall(pattern, page('measured.md') + page('journal.md'))
    assert len(shown) >= 8
    assert [figure for figure in shown if figure not in measured] == []


def test_the_documents_count_the_statements_as_the_results_do() -> None:
    results = page('results.md')
    [counted] = re.findall(r'Of (\d+) statements (\d+) hold, (\d+) do not hold', results)
    assert counted[0] == str(len(CLAIMS))
    for text in (README, page('measured.md')):
        words = ' '.join(text.split())
        assert re.findall(r'(\d+) statements (\d+) hold and (\d+) do not', words) == [counted]


@pytest.mark.parametrize('path', sorted((ROOT / 'docs').rglob('*.md')), ids=name_of)
def test_every_page_opens_with_a_paragraph(path: Path) -> None:
    title, opening = path.read_text().split('\n\n')[:2]
    assert re.fullmatch('# .+', title)
    assert re.match(r'[A-Z]', opening)
    assert len(opening.split()) >= 20


@pytest.mark.parametrize('path', DOCUMENTS, ids=name_of)
def test_every_block_of_code_can_be_read(path: Path) -> None:
    found = [block for block in all_blocks() if block.document == path]
    assert {block.language for block in found} <= {'sh', 'python', 'yaml', 'csv', 'text'}
    for block in found:
        if block.language == 'python':
            assert [*names_that_lead_nowhere(block.text)] == []
        if block.language == 'yaml':
            assert yaml.safe_load(block.text)


def names_that_lead_nowhere(program: str) -> Iterator[str]:
    """What a program takes out of our package that is not there."""
    for node in ast.walk(ast.parse(program)):
        if isinstance(node, ast.ImportFrom) and (node.module or '').startswith('uav_collect'):
            home = import_module(str(node.module))
            yield from (it.name for it in node.names if not hasattr(home, it.name))


def test_a_name_that_leads_nowhere_is_seen() -> None:
    assert [*names_that_lead_nowhere('from uav_collect import fly, swim')] == ['swim']


def test_every_function_and_test_in_the_paper_map_is_there() -> None:
    named = re.findall(r'`([\w/]+\.py)::([\w.]+)`', PAPER_MAP)
    folders = {True: ROOT / 'test', False: ROOT / 'uav_collect'}
    missing = [
        f'{file}::{name}'
        for file, name in named
        if name not in defined_names(folders[Path(file).name.startswith('test_')] / file)
    ]
    assert len(named) > 100
    assert missing == []


def test_every_name_in_the_glossary_is_in_the_code() -> None:
    names = [*names_in_the_glossary()]
    assert len(names) > 150
    assert [name for name in names if not (is_in_the_code(name) or is_a_key(name))] == []


@pytest.mark.parametrize('name', ['uav.belief.Belief', 'world.sensor_field', 'energy_left_j'])
def test_a_name_that_is_not_in_the_code_is_seen(name: str) -> None:
    assert is_in_the_code(name)
    assert not is_in_the_code(f'{name}x')


def never_words() -> list[str]:
    """The words that the glossary keeps out of names."""
    _, _, section = GLOSSARY.partition('## Never')
    cells = re.findall(r'^\| ([a-z, ]+) \|', section, re.MULTILINE)
    return [word for cell in cells for word in cell.split(', ') if word != 'never']


def words_of(path: str, source: str) -> set[str]:
    """The words of which the names of a file are made, its own name included."""
    fields, nodes = ('id', 'attr', 'name', 'arg', 'asname'), ast.walk(ast.parse(source))
    found = {getattr(node, field, None) for node in nodes for field in fields}
    names = [path, *(name for name in found if isinstance(name, str))]
    return {word.lower() for word in re.findall(r'[A-Z]?[a-z]+|[A-Z]+(?![a-z])', ' '.join(names))}


def unwanted(sources: Sources) -> list[str]:
    """Words of names that begin like one of the glossary's never."""
    never = tuple(never_words())
    return [
        f'{path}: {word}'
        for path, source in sources.items()
        for word in sorted(words_of(path, source))
        if word.startswith(never)
    ]


@pytest.mark.parametrize('folder', ['bench', 'launch', 'test', 'tools', 'uav_collect'])
def test_no_name_is_made_of_a_word_that_must_not_come_back(folder: str) -> None:
    assert len(never_words()) > 10
    assert unwanted(read(ROOT / folder)) == []


@pytest.mark.parametrize(
    ('path', 'source'),
    [
        ('lockstep/cockpit.py', ''),
        ('uav/agent.py', 'class NewCockpit: ...'),
        ('uav/agent.py', 'def look(told_s): ...'),
        ('uav/agent.py', 'from uav_collect.planning import Errands as Plan'),
        ('uav/agent.py', 'self._errands.search(retraced=True)'),
    ],
)
def test_a_word_that_comes_back_is_seen(path: str, source: str) -> None:
    assert unwanted({path: source, 'uav/view.py': 'text = "as was told"'}) != []
    assert unwanted({'uav/view.py': 'text = "as was told"'}) == []


def test_every_option_in_the_paper_map_is_a_key_of_a_scenario() -> None:
    tops = '|'.join(load('rough_10x10').as_mapping())
    paths = re.findall(rf'`((?:{tops})\.[\w.]+)`', PAPER_MAP.replace('.py', '#'))
    assert [path for path in paths if not is_a_key(path)] == []


@pytest.mark.parametrize('name', scenario_names())
def test_every_shipped_scenario_is_in_the_first_tutorial(name: str) -> None:
    text = page('tutorials/first_mission.md')
    assert re.search(rf'^\| .*`{name}`.* \|', text, re.MULTILINE)


def test_every_room_has_its_line_in_contributing_in_the_order_of_imports() -> None:
    cells = re.findall(r'^\| (`\w.*?) \|', CONTRIBUTING, re.MULTILINE)
    assert re.findall(r'`(\w+)(?:/|\.py)`', ' '.join(cells)) == [*ORDER]


@pytest.mark.parametrize('name', names_in(shared_folders('studies')))
def test_the_documents_know_how_much_each_scale_trains_and_flies(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = page('how_to/paper_studies.md')
    [written] = re.findall(rf'^\| `{name}` \| .* \| (\d+) \| (\d+) \| .* \|$', text, re.MULTILINE)
    assert main(['figures', '--scale', name, '--dry-run', '--output', str(tmp_path)]) == 0
    trainings = re.findall(r'(\d+) of training', capsys.readouterr().out)
    assert written == (*trainings, str(load_scale(name).tests.missions))


def test_every_package_has_its_line_in_the_architecture() -> None:
    text = page('contributing/architecture.md')
    packages = sorted(path.parent.name for path in (ROOT / 'uav_collect').glob('*/__init__.py'))
    assert len(packages) > 15
    assert [name for name in packages if f'`{name}/`' not in text] == []


def test_the_scenario_of_the_documents_is_valid(tmp_path: Path) -> None:
    text = page('how_to/own_scenario.md')
    [described], [csv] = blocks(text, 'yaml'), blocks(text, 'csv')
    (tmp_path / 'my_field.yaml').write_text(described)
    (tmp_path / 'my_field.csv').write_text(csv)
    scenario = load(tmp_path / 'my_field.yaml')
    assert build_site(scenario).n_sensors == csv.count('\n') - 1
    assert scenario.uavs[1].home_m == (450.0, 30.0)


def in_a_process_of_its_own(arguments: list[str], folder: Path) -> str:
    """What Python prints that runs in a folder, with the tutorial's policy in it."""
    (folder / 'my_policies.py').write_text('\n\n'.join(blocks(OWN_POLICY, 'python')[:2]))
    variables = {'PYTHONPATH': str(ROOT), 'UAV_COLLECT_KERNELS': 'interpreted'}
    return completed(sys.executable, *arguments, cwd=folder, env=os.environ | variables).stdout


@pytest.mark.parametrize('name', ['nearest', 'Rows'])
def test_the_policies_of_the_tutorial_fly(name: str, tmp_path: Path) -> None:
    options = ['--policy', f'my_policies:{name}', '--missions', '3', '--json', 'figures.json']
    in_a_process_of_its_own(['-m', 'uav_collect', 'evaluate', *options], tmp_path)
    [flown] = json.loads((tmp_path / 'figures.json').read_text()).values()
    assert flown['complete_share']['mean'] == flown['safe_share']['mean'] == 1.0


def test_the_ten_lines_of_the_tutorial_fly_and_draw_a_mission(tmp_path: Path) -> None:
    *_, program = blocks(OWN_POLICY, 'python')
    assert len(program.splitlines()) == 10
    assert program.count('missions=100') == 1
    script = program.replace('missions=100', 'missions=2')
    printed = in_a_process_of_its_own(['-c', script], tmp_path)
    assert 'paper_10x10, mission seed 7: nearest, exact bandwidth' in printed
    assert '2 missions from seed 0' in printed
    assert (tmp_path / 'mission.png').stat().st_size > 10_000


def test_the_program_of_the_tutorial_reads_a_bag(tmp_path: Path) -> None:
    [program] = blocks(page('tutorials/bags.md'), 'python')
    scenario = load('paper_8x8')
    [log] = fly(build_site(scenario), [7], 'sweep')
    bag = HandMadeBag(tmp_path / 'bag')
    bag.add_scenario(build_site(scenario))
    bag.add_mission(log, 'flown-0')
    bag.writer.close()
    done = completed(sys.executable, '-c', program, tmp_path / 'bag')
    assert done.stdout.count("mission_id='flown-0'") == 2


def learned() -> str:
    """What the program of the tutorial prints after fewer missions."""
    [program] = blocks(OWN_ALGORITHM, 'python')
    assert program.count('range(300)') == 1
    with redirect_stdout(StringIO()) as printed:
        exec(program.replace('range(300)', 'range(6)'), {'__name__': 'tutorial'})
    return printed.getvalue()


def test_the_learner_of_the_tutorial_runs() -> None:
    assert re.fullmatch(r'\d+% of the data at first, \d+% in the end\n', interpreted(learned))


def test_a_list_becomes_a_field_that_is_sized_and_that_a_fault_befalls(tmp_path: Path) -> None:
    tutorial = page('tutorials/plan_a_field.md')
    [loggers], [commands] = blocks(tutorial, 'csv'), blocks(tutorial, 'sh')
    [faulty] = blocks(page('how_to/faults.md'), 'yaml')
    (tmp_path / 'loggers.csv').write_text(loggers)
    (tmp_path / 'faulty.yaml').write_text(faulty)
    make_field, size, *_ = (shlex.split(line) for line in commands.splitlines())
    [field] = made(make_field[1:])
    in_a_process_of_its_own(['-m', 'uav_collect', *field], tmp_path)
    assert load(tmp_path / 'loggers.yaml').n_uavs == 3
    assert size[-2:] == ['--missions', '500']
    sized = in_a_process_of_its_own([*size[1:-1], '2'], tmp_path)
    assert 'all data in 2 of 2 missions' in sized
    scenario = load(tmp_path / 'faulty.yaml')
    [log] = fly(build_site(scenario), [0], 'sweep')
    assert [(it.uav, it.fault, it.time_s) for it in log.faults] == [(2, 'gone', 5.0)]


@pytest.mark.ros
def test_the_program_that_watches_a_topic_shows_how_a_mission_starts_and_ends(
    processes: Processes,
) -> None:
    [program] = blocks(page('how_to/nodes.md'), 'python')
    watch = processes.run('watch', sys.executable, '-c', program)
    world = processes.start('world_sim', '--ros-args', '-p', 'wait_for_agents:=false')
    assert [watch.wait_for(r'Mission\(.* phase=(\d)')[1] for _ in range(2)] == ['0', '1']
    assert world.wait_for_exit() == 0


@pytest.mark.ros
def test_the_test_that_contributing_shows_passes(processes: Processes) -> None:
    [program] = blocks(CONTRIBUTING, 'python')
    shown: dict[str, Any] = {'Processes': Processes, 'pytest': pytest, 'signal': signal}
    exec(program, shown)
    [test] = [it for name, it in shown.items() if name.startswith('test_')]
    test(processes)


def test_the_first_mission_is_chosen_and_flown_as_the_tutorial_shows(tmp_path: Path) -> None:
    [shown, *_] = blocks(page('tutorials/first_mission.md'), 'text')
    program = (
        'import uav_collect\n'
        "chosen = uav_collect.choose_policy('paper_10x10')\n"
        "print(chosen, uav_collect.fly('paper_10x10', chosen.policy, seed=0))"
    )
    printed = in_a_process_of_its_own(['-c', program], tmp_path)
    numbers = (
        r'^(?:[> ] \w+ .* 100\.0 %|\S.* sampled missions: .*|flown by .*|    [12] .* complete)'
    )
    lines = re.findall(numbers, shown.split('picture:')[0], re.MULTILINE)
    assert len(lines) == 9
    assert [line for line in lines if line not in printed] == []


def test_few_missions_size_a_fleet_as_the_page_shows(tmp_path: Path) -> None:
    text = page('how_to/fleet_size.md')
    [shown], [command, *_] = blocks(text, 'text'), blocks(text, 'sh')
    asked = command.split(' --complete')[0].split()[1:]
    printed = in_a_process_of_its_own([*asked, '--missions', '20'], tmp_path)
    assert shown in printed
