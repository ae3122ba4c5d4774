"""What a field gets: as asked for, else as config/fields has it."""

from dataclasses import dataclass
from typing import Annotated

from uav_collect.config import layers
from uav_collect.config.installed import shared_folders
from uav_collect.config.rules import name, number, pair, Section, validated, whole
from uav_collect.scenario.model import Point

_FILE = 'usual'


class FieldSettings(Section):
    """Values that are proposed for any field, and the rules by which others are found."""

    base: Annotated[str, name()]  # scenario that the written one extends
    altitude_m: Annotated[float, number(1, 1000, 'm')]
    rate_share: Annotated[float, number(0.01, 0.99)]  # of a sensor in a corner to one right below
    data_cells_per_uav: Annotated[int, whole(1, 1000)]
    least_cell_size_m: Annotated[float, number(0.1, 1000, 'm')]
    data_mbit: Annotated[Point, pair(number(0, 1e4), 'a list [low, high] [Mbit]', is_span=True)]
    contact_range_m: Annotated[float, number(0, 1e6, 'm')]
    airframe: Annotated[str, name()]
    battery_wh: Annotated[float, number(0.001, 1e5, 'Wh')]
    battery_usable_share: Annotated[float, number(0.01, 1)]
    margin_share: Annotated[float, number(0, 0.9)]


@dataclass(frozen=True, kw_only=True)
class Wishes:
    """What is not to be proposed, as it was asked for; None: propose it."""

    n_uavs: int
    cell_size_m: float | None = None
    altitude_m: float | None = None
    airframe: str | None = None  # `scenario.airframes.airframe_names`
    battery_wh: float | None = None
    speeds_mps: tuple[float, ...] | None = None  # by UAV
    data_mbit: Point | None = None


def usual_settings() -> FieldSettings:
    """The settings that come with the package.

    Raises:
        ConfigError: their file is missing, or was changed to what cannot be used.
    """
    path = layers.find(_FILE, shared_folders('fields'), field='settings')
    return validated(FieldSettings, layers.read(path, ()))
