"""Installs uav_collect as colcon's ament_python build expects."""

from pathlib import Path

from setuptools import find_packages, setup

NAME = 'uav_collect'
SHARED_FOLDERS = ('config', 'launch')


def shared_files() -> list[tuple[str, list[str]]]:
    """List what goes to share/uav_collect: every file of the shared folders, folder by folder."""
    files_of: dict[str, list[str]] = {}
    for path in sorted(path for top in SHARED_FOLDERS for path in Path(top).rglob('*')):
        if path.is_file() and path.suffix != '.pyc':
            files_of.setdefault(f'share/{NAME}/{path.parent}', []).append(str(path))
    return list(files_of.items())


setup(
    name=NAME,
    version='0.1.0',
    packages=find_packages(include=[NAME, f'{NAME}.*']),
    package_data={f'{NAME}.film': ['page/*']},
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{NAME}']),
        (f'share/{NAME}', ['package.xml']),
        *shared_files(),
    ],
    install_requires=['setuptools'],
    extras_require={
        'test': ['pytest'],  # lets colcon test run pytest
        'cluster': ['ray==2.60.0'],  # as requirements/cluster.txt
        'pettingzoo': ['gymnasium==1.4.0', 'pettingzoo==1.27.0'],  # as requirements/pettingzoo.txt
        'train': ['torch==2.13.0', 'tensorboard==2.21.0'],  # as requirements/train.txt
    },
    zip_safe=True,
    maintainer='uav_collect maintainers',
    maintainer_email='maintainers@example.org',
    description='Fleets of UAVs that collect data from ground sensors, on ROS 2.',
    license='Apache-2.0',
    entry_points={
        'console_scripts': [
            'world_sim = uav_collect.nodes.executables:world_sim',
            'uav_agent = uav_collect.nodes.executables:uav_agent',
            'recorder = uav_collect.nodes.executables:recorder',
            'trainer = uav_collect.nodes.executables:trainer',
            'verify = uav_collect.__main__:verify',
            'control = uav_collect.nodes.executables:control',
            'viewer = uav_collect.nodes.executables:viewer',
            'doctor = uav_collect.__main__:doctor',
            'evaluate = uav_collect.__main__:evaluate',
            'field = uav_collect.__main__:field',
            'size = uav_collect.__main__:size',
            'mission = uav_collect.__main__:mission',
            'train = uav_collect.__main__:train',
            'refine = uav_collect.__main__:refine',
            'train_fleet = uav_collect.__main__:train_fleet',
            'curves = uav_collect.__main__:curves',
            'bound = uav_collect.__main__:bound',
            'figures = uav_collect.__main__:figures',
            'report = uav_collect.__main__:report',
        ],
    },
)
