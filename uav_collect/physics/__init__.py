"""Radio, energy and bandwidth: pure functions of numbers, each with its equation."""
