"""What colcon, pip and a reader of the messages rely on, and the walls between rooms."""

import ast
from collections.abc import Callable
from importlib.metadata import packages_distributions
import os
from pathlib import Path
import re
import shutil
import signal
import sys
from typing import NamedTuple
import venv

from catkin_pkg.package import parse_package
from node_starts import said_at_start
from processes import completed, Processes, wait_until
import pytest
import uav_collect
from uav_collect.__main__ import SUMMARIES
from uav_collect.config.packages import MESSAGES, NEEDED, PACKAGES, ROS_PACKAGES

from tools import structure
from tools.structure import Sources

ROOT = Path(__file__).parent.parent
INTERFACES = sorted(
    path for path in (ROOT / 'msg_defs').glob('*/*') if path.suffix in ('.msg', '.srv', '.action')
)
SOURCES = structure.read()
LOCKSTEP_TESTS = structure.read(ROOT / 'test' / 'lockstep')
LAUNCH_FILES = structure.read(ROOT / 'launch')
TESTS = structure.read(ROOT / 'test')
ROS_MODULES = {*ROS_PACKAGES, MESSAGES}
STANDARD = {*sys.stdlib_module_names}
# Nodes are called otherwise than their modules, as commands are not.
NODES = {
    **{'world_sim': 'world', 'uav_agent': 'agent', 'recorder': 'recorder', 'trainer': 'trainer'},
    **{'control': 'control', 'viewer': 'viewer'},
}

CPP_KEYWORDS = {
    *re.findall(
        r'\w+',
        'alignas alignof and and_eq asm auto bitand bitor bool break case catch char class '
        'compl concept const const_cast constexpr continue decltype default delete do double '
        'dynamic_cast else enum explicit export extern false float for friend goto if inline '
        'int long mutable namespace new noexcept not not_eq nullptr operator or or_eq private '
        'protected public register reinterpret_cast requires return short signed sizeof static '
        'static_assert static_cast struct switch template this thread_local throw true try '
        'typedef typeid typename union unsigned using virtual void volatile wchar_t while xor '
        'xor_eq',
    )
}

UNITS = {
    **{'_bit_per_j': 'bit/J', '_bit': 'bit', '_hz': 'Hz', '_j': 'J', '_mps': 'm/s'},
    **{'_m': 'm', '_s': 's'},
}


class Wall(NamedTuple):
    """Packages that only sources below some paths may import."""

    packages: set[str]
    homes: tuple[str, ...]


TORCH_HOMES = ('learning/', 'nodes/trainer/', 'studies/jobs/learning.py', 'commands/train.py')
WALLS = {
    'ROS': Wall(ROS_MODULES, ('nodes/',)),
    'torch': Wall({'torch'}, TORCH_HOMES),
    'TensorBoard': Wall({'tensorboard'}, ('training/tensorboard.py',)),
    'PettingZoo': Wall({'gymnasium', 'pettingzoo'}, ('environments/',)),
    'Ray': Wall({'ray'}, ('studies/jobs/cluster.py',)),
    'Matplotlib': Wall({'matplotlib'}, ('analysis/plotting.py',)),
    'Pillow': Wall({'PIL'}, ('film/animation.py',)),
    'websockets': Wall({'websockets'}, ('film/server.py',)),
}
# Rooms that never import others, though they would not import upward if they did.
APART = {
    'commands': {'nodes'},
    'studies': {'nodes'},
    'uav': {'world'},
}


def foreign_imports(source: str) -> set[str]:
    """Packages other than ours that a source imports anywhere."""
    return {name.partition('.')[0] for name in structure.imported(source)} - {
        *('uav_collect', '__future__'),
    }


def imports_of(sources: Sources) -> set[str]:
    """Packages that some sources import, other than ours and the standard library."""
    return set().union(*map(foreign_imports, sources.values())) - STANDARD


def loaded_by(module: str) -> set[str]:
    """Packages, ROS's apart, that a module and all that it leads to may import."""
    graph = structure.module_graph(SOURCES)
    reached, waiting = {module}, [module]
    while waiting:
        waiting += (new := graph[waiting.pop()] - reached)
        reached |= new
    found = {path: it for path, it in SOURCES.items() if structure.module_of(path) in reached}
    return {it.name for it in PACKAGES.values() if it.top_module in imports_of(found)}


def beyond(wall: Wall, sources: Sources) -> set[str]:
    """Sources that import what stands behind a wall, and stand before it."""
    return {
        path
        for path, source in sources.items()
        if foreign_imports(source) & wall.packages and not path.startswith(wall.homes)
    }


def importers_of(rooms: set[str], room: str, sources: Sources) -> set[str]:
    """Modules of a room that import others."""
    return {
        module
        for module, others in structure.module_graph(sources).items()
        if structure.room_of(module) == room and {*map(structure.room_of, others)} & rooms
    }


def classes_of_one_name(sources: Sources) -> dict[str, list[str]]:
    """Public classes that share their name, with where they stand."""
    paths: dict[str, list[str]] = {}
    for path, source in sources.items():
        for node in ast.parse(source).body:
            if isinstance(node, ast.ClassDef) and not node.name.startswith('_'):
                paths.setdefault(node.name, []).append(path)
    return {name: found for name, found in paths.items() if len(found) > 1}


def needing_ros(tests: Sources) -> set[str]:
    """Sources of tests that run only where ROS is."""
    marks = ('pytest.mark.ros', 'importorskip')
    return {
        path
        for path, source in tests.items()
        if foreign_imports(source) & ROS_MODULES or any(mark in source for mark in marks)
    }


def test_no_import_runs_upward() -> None:
    assert structure.upward(structure.module_graph(SOURCES)) == []


@pytest.mark.parametrize(
    'source',
    [
        'from uav_collect.commands import options',
        'import uav_collect.nodes.topics',
        'def late() -> None:\n    from uav_collect.world.dynamics import Mission',
        'if TYPE_CHECKING:\n    from uav_collect import learning',
    ],
)
def test_an_import_that_runs_upward_is_seen(source: str) -> None:
    sources = {
        **dict.fromkeys(('commands/options.py', 'learning/__init__.py', 'nodes/topics.py'), ''),
        **{'uav/belief.py': source, 'world/dynamics.py': ''},
    }
    assert len(structure.upward(structure.module_graph(sources))) == 1


def test_a_room_without_a_place_is_seen() -> None:
    assert structure.upward({'attic.box': set()}) == ['attic has no place']


def test_no_imports_run_in_a_circle() -> None:
    modules = structure.module_graph(SOURCES)
    assert structure.circles(modules) == []
    assert structure.circles(structure.room_graph(modules)) == []


def test_a_circle_is_seen_among_rooms_even_if_modules_have_none() -> None:
    modules = structure.module_graph(
        {
            'world/dynamics.py': 'from uav_collect.uav import view',
            'uav/view.py': '',
            'uav/agent.py': 'from uav_collect.world.sensor_field import Ground',
            'world/sensor_field.py': 'import numpy',
        }
    )
    assert structure.circles(modules) == []
    assert structure.circles(structure.room_graph(modules)) == [('uav', 'world')]


def test_a_circle_is_seen_among_modules_of_a_room() -> None:
    sources = {
        'uav/agent.py': 'def late() -> None:\n    from uav_collect.uav.policy import Policy',
        'uav/policy.py': 'import uav_collect.uav.belief',
        'uav/belief.py': 'from uav_collect.uav.agent import Agent',
        'uav/actions.py': 'from uav_collect.uav.agent import Agent',
    }
    circle = ('uav.agent', 'uav.belief', 'uav.policy')
    assert structure.circles(structure.module_graph(sources)) == [circle]


def test_floors_are_the_longest_chain_of_imports() -> None:
    graph = {'a': {'b', 'd'}, 'b': {'c'}, 'c': {'b', 'd'}, 'd': set()}
    assert structure.longest_chain(graph) == ('a', 'b', 'd')  # b and c, a circle, are one floor
    graph['d'] = {'e'}
    graph['e'] = set()
    assert structure.longest_chain(graph) == ('a', 'b', 'd', 'e')


def test_the_files_of_a_decision_are_those_that_run_from_one_to_the_next(tmp_path: Path) -> None:
    functions: dict[str, Callable[[], None]] = {}
    for module, name in (('a', 'start'), ('b', 'look'), ('batch_kernels', 'carry_out')):
        code = compile(f'def {name}(): pass', str(tmp_path / f'{module}.py'), 'exec')
        exec(code, functions)

    def fly() -> None:
        for name in ('start', 'carry_out', 'look', 'carry_out', 'look', 'carry_out', 'start'):
            functions[name]()

    assert structure.Tracer(tmp_path).trace(fly) == ('b', 'batch_kernels')


def test_consoles_that_might_take_names_for_markup_stand_in_one_module() -> None:
    makers = re.compile(r'\b(Console|TextColumn|from_markup|render_markup)\(')
    users = {path for path, source in SOURCES.items() if makers.search(source)}
    assert users == {'analysis/console.py'}


def test_no_public_class_name_is_there_twice() -> None:
    assert classes_of_one_name(SOURCES) == {}


def test_a_public_class_name_that_is_there_twice_is_seen() -> None:
    sources = {'uav/plan.py': 'class Plan: ...', 'planning/bound.py': 'class Plan: ...'}
    assert classes_of_one_name(sources) == {'Plan': ['uav/plan.py', 'planning/bound.py']}
    private = {path: source.replace('Plan', '_Plan') for path, source in sources.items()}
    assert classes_of_one_name(private) == {}


@pytest.mark.parametrize('wall', WALLS.values(), ids=WALLS)
def test_a_package_is_imported_behind_its_wall_alone(wall: Wall) -> None:
    assert beyond(wall, SOURCES) == set()
    # A wall with nobody behind it would watch nothing.
    assert beyond(wall._replace(homes=('nowhere/',)), SOURCES) != set()


@pytest.mark.parametrize('wall', WALLS.values(), ids=WALLS)
def test_a_package_before_its_wall_is_seen(wall: Wall) -> None:
    for package in wall.packages:
        late = f'def late() -> None:\n    from {package}.part import Thing'
        sources = {'uav/agent.py': late, f'{wall.homes[0]}': f'import {package}.part as part'}
        assert beyond(wall, sources) == {'uav/agent.py'}


@pytest.mark.parametrize('room', APART)
def test_rooms_keep_apart(room: str) -> None:
    assert importers_of(APART[room], room, SOURCES) == set()


@pytest.mark.parametrize('room', APART)
def test_rooms_that_do_not_keep_apart_are_seen(room: str) -> None:
    [other] = APART[room]
    source = f'from uav_collect.{other}.part import Thing'
    sources = {f'{room}/one.py': source, f'{other}/part.py': source, 'planning/one.py': source}
    assert importers_of({other}, room, sources) == {f'{room}.one'}


def test_lockstep_is_tested_without_ros() -> None:
    assert len(LOCKSTEP_TESTS) > 2
    assert needing_ros(LOCKSTEP_TESTS) == set()


@pytest.mark.parametrize(
    'source',
    [
        'import rclpy',
        'from uav_collect_msgs.msg import Command',
        "rclpy = pytest.importorskip('rclpy')",
        '@pytest.mark.ros\ndef test_something() -> None: ...',
    ],
)
def test_a_test_that_needs_ros_is_seen(source: str) -> None:
    assert needing_ros({'test_inbox.py': source, 'test_roster.py': 'import pytest'}) == {
        'test_inbox.py'
    }


def pinned(name: str) -> set[str]:
    """Packages that a file of requirements/ lists."""
    pins = (ROOT / 'requirements' / name).read_text()
    return {name.lower() for name in re.findall(r'^([\w.-]+)==', pins, re.MULTILINE)}


def test_every_import_is_a_direct_requirement() -> None:
    files = ('run.txt', 'train.txt', 'pettingzoo.txt', 'cluster.txt')
    required = set().union(*map(pinned, files))
    modules = imports_of(SOURCES) - ROS_MODULES
    providers = packages_distributions()
    providers_of = {module: {name.lower() for name in providers[module]} for module in modules}
    assert {module for module, names in providers_of.items() if not names & required} == set()


@pytest.mark.parametrize('executable', sorted({*NEEDED} - {'doctor'}))
def test_an_executable_asks_for_the_packages_that_it_imports(executable: str) -> None:
    node = NODES.get(executable)
    name = executable.replace('-', '_')
    imported = loaded_by(f'nodes.{node}.node' if node else f'commands.{name}')
    optional = {it.name for it in PACKAGES.values() if it.only_for}
    assert {*NEEDED[executable]} - optional == imported - optional
    assert imported >= {*NEEDED[executable]}


def test_every_executable_says_what_it_needs() -> None:
    assert NEEDED.keys() == {*SUMMARIES, *NODES}


def test_every_package_that_is_imported_has_an_entry() -> None:
    known = {*ROS_MODULES, *(it.top_module for it in PACKAGES.values())}
    assert imports_of(SOURCES) == known


def test_the_manifest_names_every_package_that_is_imported_or_says_that_pip_has_it() -> None:
    manifest = parse_package(str(ROOT))
    by_pip = re.findall(r'<!-- pip install ([\w. ]+):', (ROOT / 'package.xml').read_text())
    *of_pip, of_tests = [{*names.split()} for names in by_pip]
    of_system = {it.apt or it.name for it in PACKAGES.values()} - set().union(*of_pip)
    assert {it.name for it in manifest.exec_depends} == {
        *(imports_of(LAUNCH_FILES) - {'yaml'}),
        *ROS_MODULES,
        *of_system,
    }
    assert set().union(*of_pip) == {it.name for it in PACKAGES.values() if not it.apt}
    endurance = structure.read(ROOT / 'tools' / 'endurance')
    own = {Path(path).stem for path in (*TESTS, *endurance)} | {'bench', 'examples', 'tools'}
    modules = {it.top_module for it in PACKAGES.values()}
    tested = imports_of(TESTS) - own - ROS_MODULES - modules - imports_of(LAUNCH_FILES)
    keys = {'action_msgs': 'action_msgs', 'catkin_pkg': 'python3-catkin-pkg-modules'}
    assert {keys.get(name, f'python3-{name}') for name in tested - of_tests} == {
        it.name for it in manifest.test_depends
    }


def test_the_manifest_of_the_messages_names_the_packages_whose_types_they_hold() -> None:
    actions = [*(ROOT / 'msg_defs').glob('action/*.action')]
    fields = '\n'.join(path.read_text() for path in {*INTERFACES, *actions})
    used = {*re.findall(r'^(\w+)/\w+', fields, re.MULTILINE)}
    used |= {'action_msgs'} if actions else set()  # of every action's status and goal
    manifest = parse_package(str(ROOT / 'msg_defs'))
    assert used == {it.name for it in manifest.build_depends}
    assert used <= {it.name for it in manifest.exec_depends}


def test_no_field_of_a_message_is_a_keyword_of_cpp() -> None:
    # Nothing here compiles the C++ code of messages; a distribution of ROS does.
    fields = '\n'.join(path.read_text() for path in INTERFACES)
    names = {*re.findall(r'^[\w/]+(?:\[[\d<=]*\])? +([a-z]\w*)', fields, re.MULTILINE)}
    assert 'energy_left_j' in names
    assert names & CPP_KEYWORDS == set()


@pytest.mark.parametrize('folder', ['Größe', 'two words', 'two\nlines'])
def test_a_clone_that_cannot_be_built_is_refused_before_anything_is_fetched(
    folder: str, tmp_path: Path
) -> None:
    clone = tmp_path / folder
    clone.mkdir()
    shutil.copytree(ROOT / 'tools', clone / 'tools')
    command = ('sh', 'tools/make_venv.sh', '.venv', 'wheels')
    done = completed(*command, status=1, cwd=clone, env={**os.environ, 'LC_ALL': 'C'})
    assert done.stdout == ''
    assert done.stderr.startswith('set-up: the path of the repository must be of A-Z')
    assert done.stderr.count('\n') == 1
    assert [it.name for it in clone.iterdir()] == ['tools']


def test_a_step_of_the_set_up_says_what_it_does_and_that_it_lasts(tmp_path: Path) -> None:
    said = tmp_path / 'said'
    step = f"until grep -q still '{said}'; do :; done; exit 7"
    with said.open('w') as file:
        completed(
            *('sh', 'tools/step.sh', 'waiting (a second)', 'sh', '-c', step),
            status=7,
            cwd=ROOT,
            env={**os.environ, 'SET_UP_LINE_EVERY_S': '0.01'},
            stdout=file,
        )
    first, second, *_ = said.read_text().splitlines()
    assert first == 'set-up: waiting (a second)'
    assert re.fullmatch(r'set-up: still waiting, for \d+ s', second)


def test_a_step_that_is_ended_ends_all_that_it_runs(processes: Processes) -> None:
    run = ('sh', '-c', 'sleep 3600 & echo begun; wait')
    step = processes.run('step', 'sh', str(ROOT / 'tools' / 'step.sh'), 'waiting', *run)
    step.wait_for('begun')
    assert step.output == 'set-up: waiting\nbegun\n'
    step.send(signal.SIGTERM)
    assert step.wait_for_exit() == 143
    wait_until(lambda: processes.survivors() == [])


def test_the_python_of_the_set_up_finds_the_package_from_anywhere(tmp_path: Path) -> None:
    environment = {key: value for key, value in os.environ.items() if key != 'PYTHONPATH'}
    venv.create(tmp_path / 'python', with_pip=False, symlinks=True)
    completed('sh', ROOT / 'tools' / 'link_package.sh', 'python', cwd=tmp_path)
    python, script = tmp_path / 'python/bin/python', 'import uav_collect as it; print(it.__file__)'
    found = completed(python, '-c', script, cwd=tmp_path, env=environment)
    assert Path(found.stdout.strip()) == ROOT / 'uav_collect' / '__init__.py'


def versions(text: str) -> set[tuple[str, str]]:
    """The pins of a requirements file: names as pip compares them, and versions."""
    pins = re.findall(r'^([\w.-]+)(?:\[\w+\])?==([\w.]+)', text, re.MULTILINE)
    return {(re.sub('[-_.]+', '-', name).lower(), version) for name, version in pins}


REQUIREMENTS = sorted((ROOT / 'requirements').glob('*.txt'))
LOCKED = sorted((ROOT / 'requirements' / 'locked').glob('*.txt'))
UBUNTU = 'ubuntu_24_04.txt'  # has older versions of what others have, too


@pytest.mark.parametrize('path', LOCKED, ids=lambda p: p.name)
def test_what_the_setup_installs_is_pinned_by_a_requirement_and_known_by_hash(path: Path) -> None:
    entries = re.split(r'\n(?=\S)', path.read_text().strip())
    assert [it for it in entries if not re.search(r'\n    --hash=sha256:[0-9a-f]{64}', it)] == []
    pins = [it.read_text() for it in REQUIREMENTS if (it.name == UBUNTU) == (path.name == UBUNTU)]
    assert versions(path.read_text()) - versions('\n'.join(pins)) == set()


@pytest.mark.parametrize(
    'path', [it for it in REQUIREMENTS if it.name != 'constraints.txt'], ids=lambda p: p.name
)
def test_every_requirement_but_torch_is_locked(path: Path) -> None:
    locked = versions('\n'.join(it.read_text() for it in LOCKED))
    assert {name for name, _ in versions(path.read_text()) - locked} <= {'torch'}


def test_packages_come_from_one_index_at_a_time() -> None:
    scripts = [ROOT / 'Makefile', *(ROOT / 'tools').glob('*.sh'), *REQUIREMENTS, *LOCKED]
    assert [it.name for it in scripts if '--extra-index-url' in it.read_text()] == []


@pytest.mark.parametrize('path', REQUIREMENTS, ids=lambda p: p.name)
def test_every_requirement_is_pinned_to_one_version(path: Path) -> None:
    lines = [line.split('#')[0].strip() for line in path.read_text().splitlines()]
    pin = re.compile(r'[\w.\-\[\]]+==[\w.]+')
    assert [line for line in lines if line and not pin.fullmatch(line)] == []


@pytest.mark.parametrize(('folder', 'kind'), [('.', 'python'), ('msg_defs', 'cmake')])
def test_a_manifest_is_valid_and_names_its_build(folder: str, kind: str) -> None:
    warnings: list[str] = []
    manifest = parse_package(str(ROOT / folder), warnings=warnings)
    assert warnings == []
    assert manifest.get_build_type() == f'ament_{kind}'
    assert manifest.version == uav_collect.__version__


@pytest.mark.parametrize('arguments', [(), ('--base-paths', 'src', 'src/uav_collect/msg_defs')])
def test_colcon_finds_both_packages(arguments: tuple[str, ...], tmp_path: Path) -> None:
    (tmp_path / 'src').mkdir()
    (tmp_path / 'src' / 'uav_collect').symlink_to(ROOT)
    colcon = shutil.which('colcon', path=Path(sys.executable).parent)
    assert colcon, 'colcon is missing: run "make test"'
    command = (colcon, '--log-base', '/dev/null', 'list', *arguments)
    listing = completed(*command, cwd=tmp_path if arguments else ROOT).stdout
    packages = {(line.split()[0], line.split()[-1]) for line in listing.splitlines()}
    assert packages == {
        ('uav_collect', '(ros.ament_python)'),
        ('uav_collect_msgs', '(ros.ament_cmake)'),
    }


def test_the_stand_in_is_a_package_of_the_real_ones_name() -> None:
    warnings: list[str] = []
    manifest = parse_package(str(ROOT / 'stand_ins' / 'tf2_msgs'), warnings=warnings)
    assert (manifest.name, manifest.get_build_type(), warnings) == ('tf2_msgs', 'ament_cmake', [])


@pytest.mark.parametrize(('prefix', 'is_built'), [('opt', False), ('install', True), ('', True)])
def test_the_stand_in_is_built_only_where_no_other_prefix_has_the_package(
    tmp_path: Path, prefix: str, is_built: bool
) -> None:
    (tmp_path / prefix / 'share' / 'tf2_msgs').mkdir(parents=True)
    (tmp_path / prefix / 'share' / 'tf2_msgs' / 'package.xml').touch()
    prefixes = f'/nowhere:{tmp_path / prefix}' if prefix else ''
    printed = completed(
        *('sh', ROOT / 'tools' / 'packages_to_build.sh'),
        cwd=tmp_path,  # what was built here before, in install, counts for nothing
        env={**os.environ, 'AMENT_PREFIX_PATH': prefixes},
    ).stdout
    assert printed.split() == ['.', 'msg_defs', *(['stand_ins/tf2_msgs'] if is_built else [])]


@pytest.mark.ros
@pytest.mark.parametrize('name', NODES)
def test_a_node_says_what_it_does_in_80_columns(
    name: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv('COLUMNS', '80')
    said = said_at_start(NODES[name], ['--help'], capsys, status=0)
    assert re.match(f'usage: {name} .*--', said, re.DOTALL)
    assert [line for line in said.splitlines() if len(line) > 80] == []


@pytest.mark.ros
def test_the_installed_command_says_what_it_does(processes: Processes) -> None:
    asked = processes.start('uav-collect', '--help')
    assert asked.wait_for_exit() == 0
    assert 'usage: uav-collect ' in asked.output


@pytest.mark.ros
def test_an_agent_needs_neither_learning_nor_compiling_nor_drawing_libraries() -> None:
    script = """
import sys
from uav_collect.nodes.executables import uav_agent
sys.argv = ['uav_agent', '--help']
try:
    uav_agent()
finally:
    print(*sys.modules)
"""
    loaded = completed(sys.executable, '-c', script).stdout.splitlines()[-1].split()
    heavy = {'torch', 'numba', 'llvmlite', 'scipy', 'cvxpy', 'clarabel', 'matplotlib', 'rosbags'}
    generating = {'em', 'lark'}  # what messages are made by
    assert 'uav_collect.nodes.agent.node' in loaded
    assert (heavy | generating) & set(loaded) == set()


def fields(path: Path) -> list[tuple[str, str]]:
    """Fields and constants of an interface, each with the comment right above it."""
    found, comment = [], ''
    for line in path.read_text().splitlines():
        if line.startswith('#'):
            comment += line[1:]
            continue
        if line and line != '---':
            found.append((line.split()[1], comment))
        comment = ''
    return found


@pytest.mark.parametrize('path', INTERFACES, ids=lambda path: path.stem)
def test_every_field_of_a_message_says_what_it_is(path: Path) -> None:
    assert [field for field, comment in fields(path) if not comment] == []


@pytest.mark.parametrize('path', INTERFACES, ids=lambda path: path.stem)
def test_every_quantity_in_a_message_says_its_unit(path: Path) -> None:
    for field, comment in fields(path):
        unit = next((unit for ending, unit in UNITS.items() if field.endswith(ending)), None)
        assert unit is None or f'[{unit}]' in comment, field
