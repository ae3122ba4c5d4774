"""Builds uav_collect: for colcon, as ament_python asks for, and as wheel and sdist for pip.

Both have the command `uav-collect`. The nodes go to lib/uav_collect, where `ros2 run` looks for
them, so that none of their names lands in a user's PATH: setup.cfg sends colcon's scripts there,
and a wheel brings a starter of each.
"""

from pathlib import Path
import re
import sys
from tempfile import TemporaryDirectory

from setuptools import Distribution, find_packages, setup

NAME = 'uav_collect'
HERE = Path(__file__).resolve().parent  # colcon builds elsewhere, with links to here
NODES = ('world_sim', 'uav_agent', 'recorder', 'trainer', 'control', 'viewer')
BY_COLCON = bool({'develop', 'install'} & {*sys.argv})  # pip and build use neither
# colcon builds the messages itself; who has a wheel, by "uav-collect messages".
SHARED_FOLDERS = ('config', 'launch', *(() if BY_COLCON else ('msg_defs', 'stand_ins')))
STARTER = 'tools/start_node.sh'
BUILD = TemporaryDirectory(prefix=f'{NAME}-', ignore_cleanup_errors=True)  # ends with this

# The oldest versions that were tried; those of make setup are pinned in requirements/.
MISSIONS = [
    *('numpy>=1.26', 'PyYAML>=6.0', 'rich>=13.7', 'numba>=0.60', 'scipy>=1.11'),
    *('matplotlib>=3.6', 'pillow>=10.2', 'websockets>=13.0'),
    *('rosbags>=0.11.9', 'lz4>=4.3', 'backports.zstd>=1.0; python_version < "3.14"'),
    *('pyproj>=3.6', 'openpyxl>=3.1', 'defusedxml>=0.7.1'),
    *('cvxpy>=1.5', 'clarabel>=0.9', 'gymnasium>=1.0', 'pettingzoo>=1.25'),
]
TRAIN = ['torch>=2.6', 'tensorboard>=2.18']
CLUSTER = [*TRAIN, 'ray>=2.60']


def pins(name: str) -> list[str]:
    """List what a file of requirements/ pins."""
    lines = (HERE / 'requirements' / name).read_text(encoding='utf-8').splitlines()
    return [line.split('#')[0].strip() for line in lines if re.match(r'[\w.-]', line)]


# The wheels fit each other in these versions alone; what builds the messages is among them.
ROS = [
    f'{pin}; python_version < "3.13"'
    for pin in (*pins('ros.txt'), *pins('build.txt'))
    if not pin.startswith('setuptools')
]


class InstallData(Distribution().get_command_class('install_data')):
    """Files of share/, and in a wheel the starters of the nodes."""

    def run(self) -> None:
        """Copy them."""
        super().run()
        if BY_COLCON:
            return
        folder = Path(self.install_dir, 'lib', NAME)
        self.mkpath(str(folder))
        for name in NODES:
            path = folder / name
            self.copy_file(str(HERE / STARTER), str(path), preserve_mode=False)
            path.chmod(0o755)
            self.outfiles.append(str(path))


def shared_files() -> list[tuple[str, list[str]]]:
    """List what goes to share/uav_collect: every file of the shared folders, folder by folder."""
    files_of: dict[str, list[str]] = {}
    for path in sorted(path for top in SHARED_FOLDERS for path in Path(top).rglob('*')):
        if path.is_file() and path.suffix != '.pyc':
            files_of.setdefault(f'share/{NAME}/{path.parent}', []).append(str(path))
    return list(files_of.items())


def places() -> dict[str, dict[str, str]]:
    """Say where to build: a wheel elsewhere, for sources may be read-only, or hold old builds."""
    if BY_COLCON or 'sdist' in sys.argv:
        return {}
    return {'egg_info': {'egg_base': BUILD.name}, 'build': {'build_base': BUILD.name}}


def scripts() -> list[str]:
    """List the executables; colcon puts them to lib/uav_collect, pip into PATH."""
    commands = ['uav-collect = uav_collect.__main__:main']
    nodes = [f'{name} = uav_collect.nodes.executables:{name}' for name in NODES]
    return commands + nodes if BY_COLCON else commands


setup(
    name=NAME,
    version='0.1.0',
    description='Fleets of UAVs that collect data from ground sensors, on ROS 2.',
    long_description=(HERE / 'README.md').read_text(encoding='utf-8'),
    long_description_content_type='text/markdown',
    maintainer='uav_collect maintainers',
    maintainer_email='uav-collect@users.noreply.github.com',
    license='Apache-2.0',
    keywords=['UAV', 'data collection', 'multi-agent', 'reinforcement learning', 'ROS 2'],
    project_urls={'Paper': 'https://arxiv.org/abs/2601.10849'},
    classifiers=[
        'Development Status :: 4 - Beta',
        'Intended Audience :: Science/Research',
        'Operating System :: POSIX :: Linux',
        'Programming Language :: Python :: 3.11',
        'Programming Language :: Python :: 3.12',
        'Programming Language :: Python :: 3.13',
        'Topic :: Scientific/Engineering',
    ],
    python_requires='>=3.11',
    packages=find_packages(include=[NAME, f'{NAME}.*']),
    package_data={f'{NAME}.film': ['page/*']},
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{NAME}']),
        (f'share/{NAME}', ['package.xml']),
        *shared_files(),
    ],
    install_requires=MISSIONS,
    extras_require={
        'train': TRAIN,
        'cluster': CLUSTER,
        'rl': ['gymnasium>=1.0', 'pettingzoo>=1.25', *TRAIN],
        'ros': ROS,
        'all': [*CLUSTER, *ROS],
        'test': ['pytest'],  # lets colcon test run pytest
    },
    entry_points={'console_scripts': scripts()},
    cmdclass={'install_data': InstallData},
    options=places(),
    zip_safe=False,
)
