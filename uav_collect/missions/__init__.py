"""Whole missions, many by kernels or one event by event: what happens when a UAV decides."""
