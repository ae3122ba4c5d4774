"""The truth: sensors and their data, flight and energy in time, rewards."""
