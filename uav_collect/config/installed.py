"""Where the files lie that come with the package: scenarios, policies, presets, studies."""

import os
from pathlib import Path


def shared_folders(kind: str) -> tuple[Path, ...]:
    """The folders config/KIND that exist: of the checkout, or the share folder of an installation.

    The first that has a file counts.
    """
    here = Path(__file__).resolve()
    inside = Path('config') / kind
    share = Path('share') / 'uav_collect' / inside
    # An installed module is PREFIX/lib/python3.x/site-packages/uav_collect/config/installed.py, or
    # FOLDER/uav_collect/config/installed.py by "pip install --target FOLDER".
    own = [here.parents[2], *here.parents[5:6]]
    prefixes = [*own, *map(Path, filter(None, _prefixes_of_ros()))]
    candidates = [here.parents[2] / inside, *(prefix / share for prefix in prefixes)]
    return tuple(folder for folder in candidates if folder.is_dir())


def _prefixes_of_ros() -> list[str]:
    return os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep)
