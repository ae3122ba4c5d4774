"""Fleets of UAVs that collect data from ground sensors, on ROS 2."""

from uav_collect.revision import VERSION

__all__ = ['__version__']

__version__ = VERSION
