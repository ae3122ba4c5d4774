"""Missions that were flown elsewhere, joined out of messages for a learner."""
