"""Every command that the documents show can be given as it stands."""

import argparse
from pathlib import Path
import re

from documents import command_lines, made, ROOT
import pytest
from uav_collect.__main__ import command_named
import yaml

ABROAD = {
    '.venv/bin/jupyter',
    '.venv/bin/jupytext',
    'colcon',
    'export',
    'fastdds',
    'pip',
    '.venv/bin/ray',
    'rviz2',
    'source',
}  # programs that are not ours
NODES = ROOT / 'uav_collect' / 'nodes'
MODULES = {  # of executables that are not commands
    **{'world_sim': 'world', 'uav_agent': 'agent', 'recorder': 'recorder', 'trainer': 'trainer'},
    **{'control': 'control', 'viewer': 'viewer'},
}
README = (ROOT / 'README.md').read_text()
TOPICS = yaml.safe_load((ROOT / 'tools' / 'pages' / 'topics.yaml').read_text())


def parse(name: str, options: list[str]) -> None:
    """Give options to the parser of a command of ours."""
    parser = argparse.ArgumentParser(exit_on_error=False)
    command_named(name).add_arguments(parser)
    parser.parse_args(options)


def parameters_of(node: str) -> set[str]:
    """The parameters of a node, by the file that holds them all."""
    of_nodes = yaml.safe_load((ROOT / 'config' / 'nodes.yaml').read_text())
    return {*of_nodes.get(f'/**/{node}', {}).get('ros__parameters', {})}


def unknown_to(executable: str, arguments: list[str]) -> list[str]:
    """Options and parameters that an executable does not have."""
    sources = [*(NODES / MODULES[executable]).glob('*.py'), NODES / 'parameters.py']
    text = '\n'.join(path.read_text() for path in sources)
    own = arguments[: arguments.index('--ros-args')] if '--ros-args' in arguments else arguments
    options = [word for word in own if word.startswith('--') and f"'{word}'" not in text]
    given = [word.partition(':=')[0] for word in arguments if ':=' in word]
    return [*options, *({*given} - parameters_of(executable))]


def is_there(words: list[str]) -> bool:
    """Whether what a line of ros2 names is ours and there."""
    match words:
        case ['run', 'uav_collect', executable, *arguments]:
            return unknown_to(executable, arguments) == []
        case ['launch', 'uav_collect', file, *arguments]:
            text = (ROOT / 'launch' / file).read_text()
            return all(f"'{word.partition(':=')[0]}'" in text for word in arguments)
        case ['action' | 'service', *rest]:
            [(kind, name)] = re.findall(r'uav_collect_msgs/(action|srv)/(\w+)', ' '.join(rest))
            return (ROOT / 'msg_defs' / kind / f'{name}.{kind}').is_file()
        case ['topic', 'list']:
            return True
        case ['topic', 'hz', name] | ['topic', 'echo', name, _]:
            return name in TOPICS
        case ['interface', 'show', type_name]:
            return (ROOT / 'msg_defs' / type_name.partition('/')[2]).with_suffix('.msg').is_file()
        case ['param', 'set', node, name, _]:
            return name in parameters_of(Path(node).name)
        case ['security', 'create_keystore' | 'create_enclave' | 'create_permission', *_]:
            return True
    return False


@pytest.mark.parametrize('words', [*command_lines()], ids=' '.join)
def test_every_command_shown_can_be_given(words: list[str]) -> None:
    match words:
        case ['make', *arguments]:
            for name, *options in made(arguments):
                parse(name, options)
        case ['uav-collect', name, *options]:
            parse(name, options)
        case ['.venv/bin/python', '-m', 'uav_collect', name, *options]:
            parse(name, options)
        case ['.venv/bin/python', '-m', 'pip', 'install', *_]:
            pass
        case ['.venv/bin/python', script]:
            assert (ROOT / script).is_file()
        case ['ros2', *rest]:
            assert is_there(rest)
        case [name, *options] if name in MODULES:
            assert unknown_to(name, options) == []
        case [program, *_]:
            assert program in ABROAD


def test_each_of_the_four_results_in_the_readme_has_a_command_that_can_be_given() -> None:
    [table] = re.findall(r'^\| question .*\n\|.*\n((?:\|.*\n)+)', README, re.MULTILINE)
    rows = re.findall(r'^\| .* \| \d+ \| `(\S+) ([^`]*)` \|$', table, re.MULTILINE)
    assert len(rows) == table.count('\n') == 4
    for name, options in rows:
        parse(name, options.split())


@pytest.mark.parametrize(
    'words',
    [
        ['run', 'uav_collect', 'uav_agent', '--ids', '1'],
        ['run', 'uav_collect', 'world_sim', '--ros-args', '-p', 'seeds:=1'],
        ['launch', 'uav_collect', 'mission.launch.py', 'scenarios:=lillgrund'],
        ['param', 'set', '/world_sim', 'real_time', '20'],
        ['topic', 'hz', '/world/epochs'],
        ['interface', 'show', 'uav_collect_msgs/msg/Epochs'],
    ],
)
def test_what_ros2_cannot_do_is_seen(words: list[str]) -> None:
    assert not is_there(words)


@pytest.mark.parametrize('arguments', [['mision'], ['mission', 'SCENE=lillgrund']])
def test_what_make_cannot_do_is_seen(arguments: list[str]) -> None:
    with pytest.raises(ValueError, match=r'the Makefile has no \['):
        made(arguments)


def test_variables_of_make_become_options() -> None:
    assert made(['mission', 'SCENARIO=lillgrund', 'ARGS=--view']) == [
        ['mission', '--scenario', 'lillgrund', '--view']
    ]
