"""The file of the policy that was refined for a scenario's file: it lies beside it."""

from pathlib import Path

from uav_collect.config.layers import is_path
from uav_collect.uav.policy_file import SUFFIX


def own_policy_file(scenario_file: Path, n_uavs: int | None = None) -> Path:
    """Where the policy of a scenario's file lies, `my_field.safetensors` beside `my_field.yaml`.

    Args:
        n_uavs: of a fleet that is not the file's own, `my_field_n4.safetensors`.
    """
    fleet = '' if n_uavs is None else f'_n{n_uavs}'
    return scenario_file.with_name(f'{scenario_file.stem}{fleet}{SUFFIX}')


def own_policies(name_or_path: str | Path, n_uavs: int) -> list[str]:
    """The policies that lie beside a scenario's file and are for a fleet, or may be, by path.

    Args:
        name_or_path: of the scenario; beside those that are shipped lies none.
        n_uavs: that fly.
    """
    if not is_path(str(name_or_path)):
        return []
    path = Path(name_or_path).absolute()
    files = (own_policy_file(path, n_uavs), own_policy_file(path))
    return [str(file) for file in files if file.is_file()]
