"""Which source this is: version and revision, as results name them to be made again."""

from functools import cache
from pathlib import Path

VERSION = '0.1.0'
UNKNOWN = 'unknown'
_TIMEOUT_S = 10.0


@cache  # of what was loaded, whatever is edited meanwhile
def git_revision() -> str:
    """The commit of the checkout, with `-dirty` where sources differ from it; else 'unknown'."""
    import subprocess  # loaded late: `import uav_collect` needs the version alone

    folder = Path(__file__).resolve().parent
    command = ('git', '-C', str(folder), 'describe', '--always', '--dirty', '--abbrev=12')
    try:
        done = subprocess.run(
            [*command, '--exclude=*'], capture_output=True, text=True, check=True,
            timeout=_TIMEOUT_S,
        )  # fmt: skip
    except (OSError, subprocess.SubprocessError):
        return UNKNOWN  # an installation, or no git
    return done.stdout.strip() or UNKNOWN
