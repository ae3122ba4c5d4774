"""What README.md, CONTRIBUTING.md and docs/ name is there, and what they show works."""

import argparse
import ast
from collections.abc import Iterator
from contextlib import redirect_stdout
from io import StringIO
import json
import os
from pathlib import Path
import re
import shlex
import subprocess
import sys

from interpreted import interpreted
import pytest
from uav_collect.__main__ import SUMMARIES
from uav_collect.commands import (
    bound,
    curves,
    evaluate,
    field,
    figures,
    mission,
    report,
    size,
    train,
    train_fleet,
    verify,
)
from uav_collect.scenario.load import load, scenario_names
from uav_collect.scenario.site import build_site

from tools.structure import ORDER, read, Sources

ROOT = Path(__file__).parent.parent
DOCUMENTS = [
    *(ROOT / name for name in ('README.md', 'CONTRIBUTING.md', 'CHANGELOG.md')),
    *sorted((ROOT / 'docs').glob('*.md')),
]
README = (ROOT / 'README.md').read_text()
CONTRIBUTING = (ROOT / 'CONTRIBUTING.md').read_text()
GLOSSARY = (ROOT / 'docs' / 'glossary.md').read_text()
CODE = '\n'.join(
    path.read_text()
    for folder in ('uav_collect', 'msg_defs', 'setup.py')
    for path in [ROOT / folder, *(ROOT / folder).rglob('*')]
    if path.suffix in ('.py', '.msg', '.srv')
)
PAPER_MAP = (ROOT / 'docs' / 'paper_map.md').read_text()
COMMANDS = {
    **{
        'verify': verify,
        'curves': curves,
        'evaluate': evaluate,
        'field': field,
        'mission': mission,
        'report': report,
    },
    **{
        'size': size,
        'train': train,
        'bound': bound,
        'figures': figures,
        'train-fleet': train_fleet,
    },
}
ABROAD = {
    'ros2',
    'rviz2',
    'colcon',
    'ray',
    'fastdds',
    'source',
    'export',
}  # programs that are not ours


def blocks(text: str, language: str) -> list[str]:
    return re.findall(rf'^```{language}\n(.*?)^```', text, re.MULTILINE | re.DOTALL)


def command_lines() -> Iterator[list[str]]:
    """The commands that the documents show, without leading variables."""
    for document in DOCUMENTS:
        for block in blocks(document.read_text(), 'sh'):
            for line in filter(None, block.splitlines()):
                yield shlex.split(line, comments=True)


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


def executables() -> set[str]:
    return set(re.findall(r"'(\w+) = uav_collect\.", (ROOT / 'setup.py').read_text()))


@pytest.mark.parametrize('path', DOCUMENTS, ids=lambda path: path.name)
def test_every_file_that_a_document_links_is_there(path: Path) -> None:
    targets = re.findall(r'\]\(([^)#]+)[^)]*\)', path.read_text())
    local = [target for target in targets if '://' not in target]
    assert [target for target in local if not (path.parent / target).exists()] == []


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


@pytest.mark.parametrize('words', [*command_lines()], ids=' '.join)
def test_every_command_shown_can_be_given(words: list[str]) -> None:
    program, *arguments = words
    targets = set(re.findall(r'^([\w-]+):.*##', (ROOT / 'Makefile').read_text(), re.MULTILINE))
    if program == 'make':
        assert {word for word in arguments if '=' not in word} <= targets
    elif program == '.venv/bin/python' and arguments[:2] == ['-m', 'uav_collect']:
        name, *options = arguments[2:]
        assert name in SUMMARIES
        if name in COMMANDS:
            parser = argparse.ArgumentParser(exit_on_error=False)
            COMMANDS[name].add_arguments(parser)
            parser.parse_args(options)
    elif program == 'ros2' and arguments[0] == 'run':
        assert arguments[1] == 'uav_collect'
        assert arguments[2] in executables()
    else:
        assert program in executables() | ABROAD


@pytest.mark.parametrize('name', scenario_names())
def test_every_shipped_scenario_is_in_the_readme(name: str) -> None:
    assert re.search(rf'^\| .*`{name}`.* \|', README, re.MULTILINE)


def test_every_room_has_its_line_in_contributing_in_the_order_of_imports() -> None:
    cells = re.findall(r'^\| (`\w.*?) \|', CONTRIBUTING, re.MULTILINE)
    assert re.findall(r'`(\w+)(?:/|\.py)`', ' '.join(cells)) == [*ORDER]


def test_every_topic_is_in_the_readme_with_its_type() -> None:
    topics = pytest.importorskip('uav_collect.nodes.topics', reason='needs the messages of ROS')
    for topic in topics.fleet_topics(1):
        name = topic.name.replace('uav_1', 'uav_N')
        assert f'| `{name}` | `{topic.type_name}` |' in README


def test_the_scenario_in_the_readme_is_valid(tmp_path: Path) -> None:
    [yaml], [csv] = blocks(README, 'yaml'), blocks(README, 'csv')
    (tmp_path / 'my_field.yaml').write_text(yaml)
    (tmp_path / 'my_field.csv').write_text(csv)
    scenario = load(tmp_path / 'my_field.yaml')
    assert build_site(scenario).n_sensors == csv.count('\n') - 1
    assert scenario.uavs[1].home_m == (450.0, 30.0)


def in_a_process_of_its_own(arguments: list[str], folder: Path) -> str:
    """What Python prints that runs in a folder, with the policy of the README in it."""
    (folder / 'my_policies.py').write_text(blocks(README, 'python')[0])
    variables = {'PYTHONPATH': str(ROOT), 'UAV_COLLECT_KERNELS': 'interpreted'}
    return subprocess.run(
        [sys.executable, *arguments],
        check=True,
        cwd=folder,
        env=os.environ | variables,
        capture_output=True,
        text=True,
    ).stdout


def test_the_policy_in_the_readme_flies(tmp_path: Path) -> None:
    options = ['--policy', 'my_policies:nearest', '--missions', '3', '--json', 'figures.json']
    in_a_process_of_its_own(['-m', 'uav_collect', 'evaluate', *options], tmp_path)
    [flown] = json.loads((tmp_path / 'figures.json').read_text()).values()
    assert flown['complete_share']['mean'] == flown['safe_share']['mean'] == 1.0


def test_the_ten_lines_in_the_readme_fly_and_draw_a_mission(tmp_path: Path) -> None:
    _, program, _ = blocks(README, 'python')
    assert len(program.splitlines()) == 10
    assert program.count('missions=100') == 1
    script = program.replace('missions=100', 'missions=2')
    printed = in_a_process_of_its_own(['-c', script], tmp_path)
    assert 'paper_10x10, mission seed 7: nearest, exact bandwidth' in printed
    assert '2 missions from seed 0' in printed
    assert (tmp_path / 'mission.png').stat().st_size > 10_000


def learned() -> str:
    """What the program in the README prints after fewer missions."""
    *_, program = blocks(README, 'python')
    assert program.count('range(300)') == 1
    with redirect_stdout(StringIO()) as printed:
        exec(program.replace('range(300)', 'range(6)'), {'__name__': 'readme'})
    return printed.getvalue()


def test_the_learner_in_the_readme_runs() -> None:
    assert re.fullmatch(r'\d+% of the data at first, \d+% in the end\n', interpreted(learned))
