"""Missions that move: films as pictures in a row, and what a page shows while one is flown."""
