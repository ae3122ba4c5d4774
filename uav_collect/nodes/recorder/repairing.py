"""What `recorder --repair` does and says."""

from contextlib import suppress
from pathlib import Path
import sys

from uav_collect import files
from uav_collect.config.arguments import error_lines
from uav_collect.errors import BagError
from uav_collect.limits import FAILED, UNUSABLE
from uav_collect.recording.bag_repair import repair


def repair_bag(bag: Path) -> int:
    """Make a bag readable and say what came of it; the exit status."""
    try:
        with suppress(FileNotFoundError):
            files.check_there(bag)
    except OSError as error:
        sys.stderr.write(error_lines(error))
        return UNUSABLE
    try:
        done = repair(bag)
    except BagError as error:
        sys.stderr.write(error_lines(error))
        return UNUSABLE
    except OSError as error:
        why = error.strerror or error
        sys.stderr.write(f'error: {bag}: cannot be repaired, nothing was changed: {why}\n')
        return FAILED
    time_s = done.last_sim_time_s
    until = '' if time_s is None else f' up to {time_s:.3f} s of simulated time'
    sys.stdout.write(f'{bag}: holds {done.n_messages} messages{until}\n')
    if done.broken_file is None:
        sys.stdout.write('nothing to repair\n')
    else:
        for damage in done.left_out:
            sys.stdout.write(f'left out: {damage}\n')
        for remark in done.remarks:
            sys.stdout.write(f'damaged, no message lost: {remark}\n')
        sys.stdout.write(f'kept {done.broken_file}\n')
    return 0
