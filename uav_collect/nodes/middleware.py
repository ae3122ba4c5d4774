"""Settings of the DDS middleware that missions want and ROS cannot express."""

from contextlib import suppress
import os
from pathlib import Path

from ament_index_python.packages import get_package_share_directory, PackageNotFoundError

_PROFILES = Path('config', 'fastdds.xml')
_VARIABLES = ('FASTRTPS_DEFAULT_PROFILES_FILE', 'FASTDDS_DEFAULT_PROFILES_FILE')  # 2.x, then 3.x


def use_quick_discovery() -> None:
    """Let this process announce itself often; call it before `rclpy.init`.

    Whoever has chosen profiles of their own keeps them.
    """
    file = _profiles_file()
    if file is not None and not any(os.environ.get(name) for name in _VARIABLES):
        os.environ.update(dict.fromkeys(_VARIABLES, str(file)))


def _profiles_file() -> Path | None:
    """The file in the checkout, or in the share folder of an installation."""
    folders = [Path(__file__).resolve().parents[2]]
    with suppress(PackageNotFoundError):
        folders.append(Path(get_package_share_directory('uav_collect')))
    return next((folder / _PROFILES for folder in folders if (folder / _PROFILES).is_file()), None)
