"""The codes of actions and of the reasons for them, with their names and steps."""

NONE = -1  # before the first action
HOVER = 0
FORWARD = 1  # north
RIGHT = 2  # east
BACKWARD = 3  # south
LEFT = 4  # west
N_ACTIONS = 5
HOME = 5  # ends a UAV's decisions; no choice of a learned policy
ACTION_NAMES = ('hover', 'forward', 'right', 'backward', 'left', 'home')  # by action

ROW_STEP = (0, 1, 0, -1, 0)  # by action, north
COLUMN_STEP = (0, 0, 1, 0, -1)  # east

# Why an action was taken.
BY_POLICY = 0
MAP_COMPLETE = 1
ENERGY_RESERVE = 2
FAILSAFE = 3
GUARD = 4  # the policy flew in circles, see `agent.guarded`
FAULT = 5  # its agent is gone on purpose, see `world.faults`
REASON_NAMES = ('policy', 'map complete', 'energy reserve', 'failsafe', 'guard', 'fault')
