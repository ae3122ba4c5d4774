# ---
# jupyter:
#   jupytext:
#     text_representation: {extension: .py, format_name: percent}
# ---

# %% [markdown]
# # Train for five minutes and see it fly
#
# A policy that starts by flying at random learns from its own missions what pays. In five
# minutes on an idle core, each of three runs passed 1.0 kbit/J; a good rule has 1.19, which
# takes half an hour to beat. If no kernels are compiled yet, that takes
# three to four minutes of processor time first. It needs what `make train` installs.

# %%
import os
from pathlib import Path
import subprocess
import sys

import uav_collect

MISSIONS = int(os.environ.get('UAV_COLLECT_NOTEBOOK_MISSIONS', '100'))
TRAINING = os.environ.get('UAV_COLLECT_NOTEBOOK_TRAINING', '--minutes 5').split()
SCENARIO = 'paper_10x10'
FOLDER = Path('runs/notebooks')  # of all that is written
RUN = FOLDER / 'five_minutes'


def command(*words):
    """Give a command of the package, as in a terminal."""
    subprocess.run([sys.executable, '-m', 'uav_collect', *map(str, words)], check=True)


# %%
command('train', '--scenario', SCENARIO, *TRAINING, '--output', RUN)

# %% [markdown]
# `curve.png` in the run folder shows how it learned. The policy that was best in validation is
# a file of some hundred kilobytes, and can be used wherever a rule can.

# %%
policy = str(RUN / 'policy.safetensors')
print(uav_collect.evaluate(SCENARIO, [policy, 'sweep', 'hert'], missions=MISSIONS))

# %% [markdown]
# And this is how it flies: `film_mission_7.html` plays the mission in a browser, with ghosts
# beside it: the same mission flown by the rules.

# %%
mission = uav_collect.fly(SCENARIO, policy, seed=7)
print(mission)
(FOLDER / 'mission_7.jsonl').write_bytes(mission.log.to_jsonl())
command('report', FOLDER / 'mission_7.jsonl', '--html')
