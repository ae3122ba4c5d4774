"""Missions as environments of Gymnasium and PettingZoo; importing this registers them."""

from gymnasium import register
from gymnasium.envs.registration import registry

ID = 'uav_collect/Mission-v0'

if ID not in registry:
    register(
        ID,
        entry_point='uav_collect.environments.turns:TurnEnv',
        vector_entry_point='uav_collect.environments.worlds:WorldsEnv',
    )
