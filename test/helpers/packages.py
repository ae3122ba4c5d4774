"""Python as it is where packages are missing or old."""

from collections.abc import Iterable, Mapping
import os
from pathlib import Path
import subprocess
import sys

from processes import completed

ROOT = Path(__file__).parents[2]


def without(folder: Path, modules: Iterable[str], versions: Mapping[str, str]) -> dict[str, str]:
    """An environment in which some modules cannot be imported, and some packages are older.

    Args:
        folder: to write to.
        modules: that are not there.
        versions: of packages, as pip tells them.
    """
    lines = ['import sys', *(f'sys.modules[{module!r}] = None' for module in modules)]
    (folder / 'sitecustomize.py').write_text('\n'.join(lines))
    for name, version in versions.items():
        metadata = folder / f'{name}-{version}.dist-info'
        metadata.mkdir()
        (metadata / 'METADATA').write_text(
            f'Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n'
        )
    paths = [str(folder), str(ROOT), os.environ.get('PYTHONPATH', '')]
    return {**os.environ, 'PYTHONPATH': os.pathsep.join(filter(None, paths))}


def run(environment: Mapping[str, str], *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run Python to its end."""
    return completed(sys.executable, *arguments, status=None, env=environment)
