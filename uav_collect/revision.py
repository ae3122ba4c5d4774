"""Which source and packages these are, as results name them to be made again."""

from contextlib import suppress
from functools import cache
from pathlib import Path

VERSION = '0.1.0'
UNKNOWN = 'unknown'
_TIMEOUT_S = 10.0
_PACKAGES = ('numpy', 'numba', 'torch')


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


def package_versions() -> dict[str, str]:
    """Versions of this package, of Python and of what results depend on, as far as it is there."""
    from importlib import metadata
    import platform

    known = {'uav_collect': VERSION, 'python': platform.python_version()}
    for name in _PACKAGES:
        with suppress(metadata.PackageNotFoundError):
            known[name] = metadata.version(name)
    return known
