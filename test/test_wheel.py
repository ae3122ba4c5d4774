"""What pip installs: a wheel that is built once here, what is in it and what it says of itself."""

from collections.abc import Iterator
from email import message_from_string
from email.message import Message
import os
from pathlib import Path
import re
import stat
import sys
from zipfile import ZipFile

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from packaging.version import Version
from processes import completed
import pytest
import uav_collect
from uav_collect.config.packages import PACKAGES

ROOT = Path(__file__).parent.parent
NODES = {'world_sim', 'uav_agent', 'recorder', 'trainer', 'control', 'viewer'}
BUILD = 'import sys; from setuptools import build_meta; build_meta.build_wheel(sys.argv[1])'


@pytest.fixture(scope='module')
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ZipFile]:
    folder = tmp_path_factory.mktemp('wheel')
    completed(sys.executable, '-c', BUILD, folder, cwd=ROOT)
    [path] = folder.iterdir()
    assert path.name == f'uav_collect-{uav_collect.__version__}-py3-none-any.whl'
    with ZipFile(path) as file:
        yield file


def text_in(wheel: ZipFile, name: str) -> str:
    return wheel.read(f'uav_collect-{uav_collect.__version__}.dist-info/{name}').decode()


@pytest.fixture
def metadata(wheel: ZipFile) -> Message:
    return message_from_string(text_in(wheel, 'METADATA'))


def required(metadata: Message, extra: str = '') -> dict[str, Requirement]:
    """What the package requires, by name, or what an extra adds to that."""
    lines = map(Requirement, metadata.get_all('Requires-Dist', []))
    where = {'python_version': '3.12', 'extra': extra}
    return {
        canonicalize_name(it.name): it
        for it in lines
        if ('extra ==' in str(it.marker)) == bool(extra)
        and (it.marker is None or it.marker.evaluate(where))
    }


def pinned(*names: str) -> dict[str, Version]:
    """The versions that files of requirements/ pin, by package."""
    text = '\n'.join((ROOT / 'requirements' / f'{name}.txt').read_text() for name in names)
    pins = re.findall(r'^([\w.-]+)(?:\[\w+\])?==([\w.]+)', text, re.MULTILINE)
    return {canonicalize_name(name): Version(version) for name, version in pins}


def test_one_name_lands_in_the_path_of_who_installs_it(wheel: ZipFile) -> None:
    entries = text_in(wheel, 'entry_points.txt').split()
    assert entries == ['[console_scripts]', 'uav-collect', '=', 'uav_collect.__main__:main']
    assert [name for name in wheel.namelist() if '.data/scripts/' in name] == []


def test_nodes_are_where_ros_looks_for_them(wheel: ZipFile) -> None:
    starters = [it for it in wheel.infolist() if '.data/data/lib/uav_collect/' in it.filename]
    assert {Path(it.filename).name for it in starters} == NODES
    assert all((it.external_attr >> 16) & stat.S_IXUSR for it in starters)


def test_every_source_and_every_file_that_is_shared_is_in_it(wheel: ZipFile) -> None:
    names = [re.sub(r'^uav_collect-[^/]*\.data/data/', '', name) for name in wheel.namelist()]
    sources = {str(path.relative_to(ROOT)) for path in (ROOT / 'uav_collect').rglob('*.*')}
    shared = {
        f'share/uav_collect/{path.relative_to(ROOT)}'
        for folder in ('config', 'launch', 'msg_defs', 'stand_ins')
        for path in (ROOT / folder).rglob('*')
        if path.is_file()
    }
    expected = {name for name in sources | shared if not name.endswith('.pyc')}
    assert len(expected) > 300
    assert expected <= {*names}
    assert {name.partition('/')[0] for name in names} == {
        *('uav_collect', 'lib', 'share', f'uav_collect-{uav_collect.__version__}.dist-info'),
    }


def test_it_says_whose_it_is_and_what_it_takes(metadata: Message) -> None:
    assert metadata['Name'] == 'uav_collect'
    assert metadata['Version'] == uav_collect.__version__
    assert metadata['Requires-Python'] == '>=3.11'
    assert metadata['License'] == 'Apache-2.0'
    assert metadata['License-File'] == 'LICENSE'
    assert metadata['Description-Content-Type'] == 'text/markdown'
    assert metadata.get_payload() == (ROOT / 'README.md').read_text()
    assert 'example.org' not in metadata['Maintainer-email']
    assert metadata['Maintainer-email'] in (ROOT / 'package.xml').read_text()
    assert f'\n## [{uav_collect.__version__}] - 20' in (ROOT / 'CHANGELOG.md').read_text()
    assert f'\nversion: {uav_collect.__version__}\n' in (ROOT / 'CITATION.cff').read_text()
    assert metadata.get_all('Project-URL') == ['Paper, https://arxiv.org/abs/2601.10849']


@pytest.mark.parametrize(
    ('extra', 'files'),
    [
        ('', ['run', 'pettingzoo']),
        ('train', ['train']),
        ('cluster', ['train', 'cluster']),
        ('rl', ['train', 'pettingzoo']),
        ('ros', ['ros', 'build']),
        ('all', ['train', 'cluster', 'ros', 'build']),
    ],
)
def test_an_extra_requires_what_is_pinned_for_its_purpose(
    extra: str, files: list[str], metadata: Message
) -> None:
    found, pins = required(metadata, extra), pinned(*files)
    assert found.keys() == pins.keys() - {'setuptools'}
    assert {name for name, it in found.items() if pins[name] not in it.specifier} == set()


def test_what_is_too_old_for_a_command_is_too_old_for_pip(metadata: Message) -> None:
    everything = {**required(metadata), **required(metadata, 'all')}
    for package in PACKAGES.values():
        [least] = everything[canonicalize_name(package.name)].specifier
        assert least.operator == '>='
        assert Version(least.version) >= Version(package.oldest or '0')


def test_ros_is_asked_for_only_where_it_has_wheels(metadata: Message) -> None:
    lines = [it for it in metadata.get_all('Requires-Dist', []) if it.startswith('ros-')]
    assert len(lines) > 20
    assert {'python_version < "3.13"' in line for line in lines} == {True}


def test_what_is_unpacked_somewhere_finds_its_files_and_starts_its_nodes(
    wheel: ZipFile, tmp_path: Path
) -> None:
    site = tmp_path / 'lib' / 'python3' / 'site-packages'
    wheel.extractall(site)
    [data] = site.glob('*.data/data')
    for inside in ('lib/uav_collect', 'share'):
        (data / inside).rename(tmp_path / inside)
    python = tmp_path / 'bin' / 'python3'
    python.parent.mkdir()
    python.write_text(f'#!/bin/sh\nexec "{sys.executable}" "$@"\n')
    python.chmod(0o755)
    environment = {**os.environ, 'PYTHONPATH': str(site), 'AMENT_PREFIX_PATH': ''}
    there = {'cwd': tmp_path, 'env': environment}
    listed = completed(python, '-m', 'uav_collect', 'list', **there).stdout
    assert '  paper_10x10_n2_aqmix  ' in listed
    starter = tmp_path / 'lib' / 'uav_collect' / 'control'
    starter.chmod(0o755)
    started = completed('sh', starter, '--help', status=None, **there)
    said = started.stdout + started.stderr
    assert re.search(r'^usage: control |^error: \w+ is missing: ', said, re.MULTILINE), said


def test_an_sdist_has_all_that_builds_the_messages_and_the_documents() -> None:
    grafted = {*re.findall(r'^graft (\S+)$', (ROOT / 'MANIFEST.in').read_text(), re.MULTILINE)}
    made = {'build', 'install', 'log', 'runs'}
    folders = {
        path.name
        for path in ROOT.iterdir()
        if path.is_dir() and not path.name.startswith(('.', '_')) and path.suffix != '.egg-info'
    }
    assert folders - made - {'uav_collect'} <= grafted
