"""Fleets of UAVs that collect data from ground sensors, on ROS 2."""

__version__ = '0.1.0'
