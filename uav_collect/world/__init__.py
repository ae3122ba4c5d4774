"""The truth, which no UAV sees whole: sensors and their data, flight and energy, rewards."""
