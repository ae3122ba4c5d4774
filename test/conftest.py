"""Fixtures and skips that several test modules share."""

from collections.abc import Iterator
import importlib.util
import os
from pathlib import Path

from hypothesis import HealthCheck, settings
from processes import executable, Processes, ros_environment
import pytest
from ros_domains import own_domain

# How long an example takes depends on what else the machine does.
settings.register_profile('unhurried', deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile('unhurried')

# Or the first small job of a process would settle how kernels run in all tests after it.
os.environ.setdefault('UAV_COLLECT_KERNELS', 'compiled')


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Let long modules begin first, so that no worker ends with one; skip what cannot run here."""
    items.sort(key=lambda item: item.get_closest_marker('long') is None)
    skip_what_needs_ros(items)


def skip_what_needs_ros(items: list[pytest.Item]) -> None:
    """Skip the tests marked `ros` where ROS or the built packages are missing."""
    needs = ('rclpy', 'uav_collect_msgs')
    missing = [name for name in needs if not importlib.util.find_spec(name)]
    if executable('world_sim') is None:
        missing.append('the installed uav_collect')
    if not missing:
        return
    skip = pytest.mark.skip(reason=f'needs {", ".join(missing)}: run "make test"')
    for item in items:
        if item.get_closest_marker('ros'):
            item.add_marker(skip)


@pytest.fixture(autouse=True)
def kernels_run_as_before(monkeypatch: pytest.MonkeyPatch) -> None:
    """A command that settles how kernels run in its process settles it for its test alone."""
    monkeypatch.setenv('UAV_COLLECT_KERNELS', os.environ['UAV_COLLECT_KERNELS'])


@pytest.fixture
def ros_domain(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """A ROS domain of the test's own, in this process and in those it starts."""
    with own_domain() as domain:
        for name, value in ros_environment(domain, tmp_path / 'ros_log').items():
            monkeypatch.setenv(name, value)
        yield domain


@pytest.fixture
def processes(ros_domain: int, tmp_path: Path) -> Iterator[Processes]:
    """Starts executables of uav_collect in the test's ROS domain; none outlives the test."""
    started = Processes(tmp_path, {'ROS_DOMAIN_ID': str(ros_domain)})
    yield started
    started.close()


@pytest.fixture
def bound_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where the test's clairvoyant bounds are kept, away from those found before."""
    from uav_collect.planning import bound

    monkeypatch.setattr(bound, 'cache_folder', lambda: tmp_path / 'cache')
    return tmp_path / 'cache'
