"""The state of a random generator in a checkpoint: of one that draws by Philox."""

from typing import Any

import numpy as np
from uav_collect.learning.saved import SavedPart


def rng_state(rng: np.random.Generator) -> dict[str, Any]:
    """What changes of it, the numbers of a Philox; the inverse is `restore_rng`."""
    state: Any = rng.bit_generator.state
    return {
        'counter': state['state']['counter'],
        **{name: state[name] for name in ('buffer', 'buffer_pos', 'has_uint32', 'uinteger')},
    }


def restore_rng(rng: np.random.Generator, saved: SavedPart) -> None:
    """Let a generator of the same key go on from where another one was.

    Raises:
        CheckpointError: what was saved is no such state.
    """
    state: Any = rng.bit_generator.state
    state['state']['counter'] = saved.array('counter', np.uint64, [4])
    state['buffer'] = saved.array('buffer', np.uint64, [4])
    state['buffer_pos'] = saved.whole('buffer_pos', high=4)
    state['has_uint32'] = saved.whole('has_uint32', high=1)
    state['uinteger'] = saved.whole('uinteger', high=2**32 - 1)
    rng.bit_generator.state = state
