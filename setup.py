"""Installs uav_collect as colcon's ament_python build expects."""

from pathlib import Path

from setuptools import find_packages, setup

NAME = 'uav_collect'
SHARED_FOLDERS = ('config', 'launch')


def shared_files() -> list[tuple[str, list[str]]]:
    """List what goes to share/uav_collect: every file of the shared folders, folder by folder."""
    folders = [
        folder
        for top in SHARED_FOLDERS
        for folder in (Path(top), *sorted(Path(top).rglob('*')))
        if folder.is_dir() and folder.name != '__pycache__'
    ]
    return [
        (f'share/{NAME}/{folder}', sorted(str(file) for file in folder.iterdir() if file.is_file()))
        for folder in folders
    ]


setup(
    name=NAME,
    version='0.1.0',
    packages=find_packages(include=[NAME, f'{NAME}.*']),
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{NAME}']),
        (f'share/{NAME}', ['package.xml']),
        *shared_files(),
    ],
    install_requires=['setuptools'],
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
            'evaluate = uav_collect.__main__:evaluate',
            'mission = uav_collect.__main__:mission',
            'report = uav_collect.__main__:report',
        ],
    },
)
