"""Bounds and choices that commands, messages, files and kernels share."""

import re
import signal

# Exit statuses, of commands and of nodes.
FAILED = 1  # it was done, and what came of it is bad; or it could not go on
UNUSABLE = 2  # what was given cannot be used, or what was found cannot be written
INTERRUPTED = 130  # after Ctrl-C, as shells have it

MAX_NAME = 64  # characters
NAME_ALLOWED = (
    f'1 to {MAX_NAME} letters of A to Z, digits, _, - and ., the first a letter or a digit'
)
_NAME = re.compile(f'[A-Za-z0-9][A-Za-z0-9_.-]{{0,{MAX_NAME - 1}}}')

MAX_SENSORS = 20_000
MAX_CORNERS = 1_000  # of a polygon
MAX_SENSOR_ID = 64  # characters
MIN_DATA_MBIT = 1e-6  # of a sensor: one bit; or 0
MAX_DATA_MBIT = 10_000.0
MAX_UAVS = 64  # the UAVs that one has heard travel as bits of a 64-bit word
MAX_CELLS_PER_SIDE = 64  # rows, and columns
MAX_NO_FLY = MAX_CELLS_PER_SIDE**2  # zones of an area: cells that are given as zones make as many
MAX_NO_FLY_CORNERS = 100_000  # of all zones of an area: some 10 s to find what they close
EGOCENTRIC_MAX_UAVS = 6  # UAVs that the egocentric observation tells apart
RELATIVE_MAX_UAVS = 16  # UAVs of a fleet that the relative observation is for
MAX_SEED = 2**62  # mission seeds count up from here and stay inside 63 bits
MAX_DECISIONS = 10**12  # of a training
MAX_LAYER_SIZE = 4096  # of a network that learns
GUARD_AFTER = 12  # decisions without news after which a UAV's guard decides, unless users say else
MAX_GUARD_AFTER = 10_000
NO_AGENT = 'none'  # in logs, the policy of a UAV that had no agent as the mission began

BEST = 'best'  # stands for the policy that does best in sampled missions of the scenario at hand
LOOKAHEAD = 'lookahead'  # and a colon, before the rule that a policy looks ahead with
LEAST_FUTURES, MOST_FUTURES = 2, 1000  # that such a policy imagines of each action

ALGORITHMS = ('aqmix', 'qmix', 'aiql', 'branches', 'imitation')  # of a training
DEVICES = ('cpu', 'cuda')  # that updates are computed on
FLEET_ALGORITHMS = ('aqmix', 'aiql')  # those whose UAVs do not wait for each other

RECORDED = ('all', 'learning')  # topics that a recorder keeps: all, or those learned from

# How bandwidth may be shared; the first two are known to kernels, by their place here.
ALLOCATOR_NAMES = ('exact', 'equal', 'cvxpy')

HANDOVER_KINDS = ('plan', 'kml', 'geojson', 'csv', 'mavlink')  # of files that `export` writes


def is_name(text: str) -> bool:
    """Whether a text may name a scenario, a preset or a policy: then it may name a file, too."""
    return _NAME.fullmatch(text) is not None


def is_lookahead_name(text: str) -> bool:
    """Whether a text names a policy that looks ahead: `lookahead:RULE` or `lookahead:RULE:N`."""
    return text.strip().startswith(f'{LOOKAHEAD}:')


def is_code_name(text: str) -> bool:
    """Whether a text has the form `module:name`, by which users name code of their own."""
    module, colon, target = text.partition(':')
    return bool(colon) and all(part.isidentifier() for part in (*module.split('.'), target))


def is_algorithm(text: str) -> bool:
    """Whether a text may name an algorithm: one of ours, or a user's."""
    return text in ALGORITHMS or is_code_name(text)


def stop_signals() -> tuple[signal.Signals, ...]:
    """The signals by which this process is asked to end, and to keep what it has.

    SIGHUP is one of them, a terminal that is closed, unless nohup has switched it off.
    """
    asked = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    return asked[:-1] if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN else asked
