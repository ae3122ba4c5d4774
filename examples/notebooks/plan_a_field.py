# ---
# jupyter:
#   jupytext:
#     text_representation: {extension: .py, format_name: percent}
# ---

# %% [markdown]
# # Plan a field
#
# Twelve loggers stand along a creek. How large should the cells be, where should the drones
# start, and how long does it take two of them to read everything? This notebook goes from the
# list of loggers to a flight over them.

# %%
import os
from pathlib import Path
import subprocess
import sys

import uav_collect

MISSIONS = int(os.environ.get('UAV_COLLECT_NOTEBOOK_MISSIONS', '100'))
FOLDER = Path('runs/notebooks')  # of all that is written
FOLDER.mkdir(parents=True, exist_ok=True)

# %% [markdown]
# The list is a table with a name and a place for each logger. Yours may be a spreadsheet or a
# map.

# %%
PLACES_M = [(40 + 55 * n, 60 + 90 * (n % 3) + 12 * n) for n in range(12)]
ROWS = [f'logger {n},{x_m},{y_m}' for n, (x_m, y_m) in enumerate(PLACES_M, start=1)]
(FOLDER / 'loggers.csv').write_text('\n'.join(['id,x_m,y_m', *ROWS]) + '\n')

# %% [markdown]
# `field` turns it into a scenario: cells as large as the radio allows, a base, and a fleet. It
# writes each value and the reason for it into `loggers.yaml`, whose beginning is shown here, and
# draws a map, `loggers.png`.

# %%
FIELD = ['field', str(FOLDER / 'loggers.csv'), '--uavs', '2', '--force', '--output', str(FOLDER)]
subprocess.run([sys.executable, '-m', 'uav_collect', *FIELD], check=True)
scenario = FOLDER / 'loggers.yaml'
print(*scenario.read_text().splitlines()[:16], sep='\n')

# %% [markdown]
# Two rules fly the same missions. What differs from mission to mission is how much data each
# logger holds, and how well it is heard.

# %%
compared = uav_collect.evaluate(scenario, ['sweep', 'hert'], missions=MISSIONS)
print(compared)

# %% [markdown]
# This is one mission flown by the better of the two, and which UAV flew where. Nothing should
# be left unread.

# %%
best = max(compared.estimates, key=lambda it: compared.estimates[it]['efficiency_kbit_per_j'].mean)
mission = uav_collect.fly(scenario, best, seed=1)
mission.draw(FOLDER / 'flight.png')
print(mission)
print('left unread:', mission.unread or 'nothing')
