"""Whole missions: many at once by kernels, one event by event, and what learners keep of them."""
