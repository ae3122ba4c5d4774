"""A reward of a user's: a point for each megabit, less one for each minute until all have landed.

python -m uav_collect train --override reward.goal=quick_data:reward
"""


def reward(outcomes):
    return outcomes.collected_bit / 1e6 - outcomes.duration_s / 60.0
