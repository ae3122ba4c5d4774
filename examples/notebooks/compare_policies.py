# ---
# jupyter:
#   jupytext:
#     text_representation: {extension: .py, format_name: percent}
# ---

# %% [markdown]
# # Compare policies
#
# Which way of deciding collects the most data for its energy? Here a learned policy, two
# rules and a function of our own fly the same missions, and all are compared with what would
# be possible with perfect knowledge.

# %%
import os

import numpy as np
import uav_collect
from uav_collect import HOVER, step_towards

MISSIONS = int(os.environ.get('UAV_COLLECT_NOTEBOOK_MISSIONS', '100'))
SCENARIO = 'paper_10x10'

# %% [markdown]
# Our own: hover where data waits, else fly to the nearest cell that is not known to be empty.


# %%
def nearest(situation):
    here, side = situation.view.cell, situation.briefing.n_columns
    if situation.legal[HOVER]:
        return HOVER
    unknown = np.flatnonzero(situation.belief.complete == 0)
    ways = abs(unknown // side - here // side) + abs(unknown % side - here % side)
    return step_towards(situation.briefing, here, unknown[ways.argmin()], situation.legal)


# %%
policies = ['strong', 'sweep', 'hert', nearest]
compared = uav_collect.evaluate(SCENARIO, policies, missions=MISSIONS)
print(compared)

# %% [markdown]
# Means over different missions differ by luck. If two policies fly the same missions, the
# results differ only by the policy, so the interval of the difference is much narrower than
# those of the two means. If it does not contain 0, the order is clear.

# %%
for other in ('sweep', 'hert', 'nearest'):
    gain = compared.difference('strong', other)['efficiency_kbit_per_j']
    print(f'strong above {other}: {gain.mean:+.3f} ({gain.low:+.3f} to {gain.high:+.3f}) kbit/J')

# %% [markdown]
# Nobody knows the demand before the flight. A fleet that did would fly the shortest plan: how
# close does a mission come to it?

# %%
mission = uav_collect.fly(SCENARIO, 'strong', seed=7)
plan = uav_collect.bound(SCENARIO, seed=7).shortest
print(f'{mission.metrics.completion_s:.0f} s, where {plan.completion_s:.0f} s would be possible')
