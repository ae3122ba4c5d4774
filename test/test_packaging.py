"""What colcon, pip and a reader of the messages rely on, and the order of the layers."""

import ast
from importlib.metadata import packages_distributions
from pathlib import Path
import re
import shutil
import subprocess
import sys

from catkin_pkg.package import parse_package
from processes import Processes
import pytest
import uav_collect

ROOT = Path(__file__).parent.parent
EXECUTABLES = (
    *('world_sim', 'uav_agent', 'recorder', 'mission', 'evaluate', 'report', 'doctor'),
    *('train', 'curves', 'bound', 'figures', 'trainer', 'train_fleet'),
)
INTERFACES = sorted((ROOT / 'msg_defs').glob('*/*.[ms][sr][gv]'))
MODULES = sorted((ROOT / 'uav_collect').rglob('*.py'))
ROS_MODULES = {
    *('ament_index_python', 'builtin_interfaces', 'diagnostic_msgs', 'geometry_msgs', 'nav_msgs'),
    *('rcl_interfaces', 'rclpy', 'rosgraph_msgs', 'std_msgs', 'uav_collect_msgs'),
    'visualization_msgs',
}

UNITS = {
    **{'_bit_per_j': 'bit/J', '_bit': 'bit', '_hz': 'Hz', '_j': 'J', '_mps': 'm/s'},
    **{'_m': 'm', '_s': 's'},
}

# A module imports from its own line and the lines above. nodes/ and commands/ import from all, but
# not from each other.
LAYERS = (
    'arrays compiled files limits memory philox rows shared_files mission_log revision',
    'training_log',
    'yaml_text config_files config_rules sensors_csv scenario_model scenario site',
    'radio energy bandwidth_newton bandwidth_reference bandwidth',
    'actions exploration briefing ground missions world belief observation reward event_log',
    'experience told',
    'frozen callable_policy policy_file heuristics policy agent',
    'batch preflight simulation airborne stepping rollout retrace assembly',
    'metrics evaluation errands plan_search plan_bound bound bound_estimates',
    'lanes plots tables bound_tables bag bag_writer bag_repair learning_curves pettingzoo_env',
    'training_config training_progress training_run training_display replay minibatch',
    'network mixer learner collector checkpoint course intake trainer scalar_events',
    'training_folder training_loop',
)
LEARNING = 'network mixer learner collector checkpoint train trainer scalar_events learning'
LAYER_OF = {module: rank for rank, line in enumerate(LAYERS) for module in line.split()}


def imports(path: Path) -> set[str]:
    """Modules that a source imports anywhere, our own as `uav_collect.` and one name."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found.update('.'.join(alias.name.split('.')[:2]) for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module == 'uav_collect':
            found.update(f'uav_collect.{alias.name}' for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            found.add('.'.join((node.module or '').split('.')[:2]))
    return found


def own_imports(path: Path) -> set[str]:
    return {name[12:] for name in imports(path) if name.startswith('uav_collect.')}


def foreign_imports(path: Path) -> set[str]:
    return {name.split('.')[0] for name in imports(path)} - {'uav_collect', '__future__'}


def core_modules() -> list[Path]:
    return [path for path in MODULES if path.parent.name == 'uav_collect' and path.stem[0] != '_']


@pytest.mark.parametrize('path', core_modules(), ids=lambda path: path.stem)
def test_a_module_imports_from_its_own_layer_and_those_below(path: Path) -> None:
    assert path.stem in LAYER_OF, 'give the new module its place in LAYERS'
    layer = LAYER_OF[path.stem]
    assert {name for name in own_imports(path) if LAYER_OF.get(name, 99) > layer} == set()


def test_commands_nodes_and_studies_keep_apart() -> None:
    folders = {
        'commands': {'nodes'},
        'nodes': {'commands', 'studies'},
        'studies': {'commands', 'nodes'},
    }
    for path in MODULES:
        assert not folders.get(path.parent.name, set()) & own_imports(path), path


def test_ros_is_imported_in_nodes_alone() -> None:
    for path in MODULES:
        assert path.parent.name == 'nodes' or not foreign_imports(path) & ROS_MODULES, path


def pinned(name: str) -> set[str]:
    """Packages that a file of requirements/ lists."""
    pins = (ROOT / 'requirements' / name).read_text()
    return {name.lower() for name in re.findall(r'^([\w.-]+)==', pins, re.MULTILINE)}


def test_every_import_is_a_direct_requirement() -> None:
    files = ('run.txt', 'train.txt', 'pettingzoo.txt', 'cluster.txt')
    required = set().union(*map(pinned, files))
    standard = set(sys.stdlib_module_names)
    modules = set().union(*map(foreign_imports, MODULES)) - standard - ROS_MODULES
    providers = packages_distributions()
    providers_of = {module: {name.lower() for name in providers[module]} for module in modules}
    assert {module for module, names in providers_of.items() if not names & required} == set()


def test_what_training_alone_needs_is_imported_by_training_alone() -> None:
    importers = {path.stem for path in MODULES if foreign_imports(path) & pinned('train.txt')}
    assert importers <= set(LEARNING.split())


def test_pettingzoo_is_imported_by_its_environment_alone() -> None:
    importers = {path.stem for path in MODULES if foreign_imports(path) & pinned('pettingzoo.txt')}
    assert importers == {'pettingzoo_env'}


def test_ray_is_imported_by_its_engine_alone() -> None:
    importers = {path.stem for path in MODULES if foreign_imports(path) & pinned('cluster.txt')}
    assert importers == {'cluster'}


@pytest.mark.parametrize('extra', ['cluster', 'pettingzoo', 'train'])
def test_an_extra_pins_what_its_requirements_file_pins(extra: str) -> None:
    pins = re.findall(r'^[\w.-]+==\S+', (ROOT / f'requirements/{extra}.txt').read_text(), re.M)
    [line] = re.findall(rf"'{extra}': \[(.*)\]", (ROOT / 'setup.py').read_text())
    assert set(re.findall(r"'([^']+)'", line)) == set(pins)


@pytest.mark.parametrize('path', sorted((ROOT / 'requirements').iterdir()), ids=lambda p: p.name)
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
    listing = subprocess.run(
        [colcon, '--log-base', '/dev/null', 'list', *arguments],
        cwd=tmp_path if arguments else ROOT,
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    packages = {(line.split()[0], line.split()[-1]) for line in listing.splitlines()}
    assert packages == {
        ('uav_collect', '(ros.ament_python)'),
        ('uav_collect_msgs', '(ros.ament_cmake)'),
    }


@pytest.mark.ros
@pytest.mark.parametrize('name', EXECUTABLES)
def test_an_executable_says_what_it_does(name: str, processes: Processes) -> None:
    asked = processes.start(name, '--help')
    assert asked.wait_for_exit() == 0
    assert re.match('usage: .*--', asked.output, re.DOTALL)


@pytest.mark.ros
def test_an_agent_needs_neither_learning_nor_compiling_nor_drawing_libraries() -> None:
    script = """
from uav_collect.kernels.compile import interpret_kernels
interpret_kernels()
import uav_collect.nodes.agent.node, sys
print(*sys.modules)
"""
    loaded = subprocess.run(
        [sys.executable, '-c', script], capture_output=True, text=True, check=True
    ).stdout.split()
    heavy = {'torch', 'numba', 'llvmlite', 'scipy', 'cvxpy', 'clarabel', 'matplotlib', 'rosbags'}
    assert heavy & set(loaded) == set()


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
