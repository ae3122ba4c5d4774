"""Missions under the names by which PettingZoo's environments are found in a module."""

from uav_collect.environments.aec import env
from uav_collect.environments.parallel import parallel_env

__all__ = ['env', 'parallel_env']
