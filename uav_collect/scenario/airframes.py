"""UAVs of a scenario file that are given by their craft and battery: `airframe`, `battery_wh`, ...

What comes out has the rotor constants and the energy budget that missions are flown by, as if the
file had said these itself.
"""

from collections.abc import Iterator
from dataclasses import fields, replace
from functools import cache
from pathlib import Path
from typing import Annotated, Any, Literal

from uav_collect.config import layers
from uav_collect.config.installed import shared_folders
from uav_collect.config.layers import Document, Ways
from uav_collect.config.rules import number, Section, validated, whole
from uav_collect.config.yaml_text import Keys, shown
from uav_collect.errors import ConfigError
from uav_collect.scenario.model import BatteryConfig, UavConfig
from uav_collect.scenario.rotors import (
    disc_area_m2,
    GRAVITY_MPS2,
    hover_tip_speed_mps,
    Rotors,
    solidity_of,
)

_FILE = 'airframes.yaml'
_COMMON = 'common'  # there: what an airframe has unless it says otherwise
KJ_PER_WH = 3.6
_AIRFRAME = 'airframe'  # key of a UAV; as its battery_wh: what the airframe's battery holds
_ENERGY = (
    frozenset({'energy_budget_kj', 'battery'}),
    frozenset({'battery_wh', 'battery_usable_share'}),
    frozenset({'battery_mah', 'battery_v', 'battery_usable_share'}),
)
_USABLE_SHARE = 'battery_usable_share'
_BATTERIES = ({'battery_wh'}, {'battery_mah', 'battery_v'})
_BATTERY_KEYS = ('battery_wh', 'battery_mah', 'battery_v', _USABLE_SHARE)
_UAV_KEYS = (*(field.name for field in fields(UavConfig)), _AIRFRAME, *_BATTERY_KEYS)
_BLADE_WAYS: tuple[Ways, ...] = (
    (frozenset({'solidity'}), frozenset({'blades', 'chord_m'})),
    (frozenset({'tip_speed_mps'}), frozenset({'lift_coefficient'})),
)
WAYS: tuple[Ways, ...] = (  # to say what a UAV's power is, and what its battery holds
    (frozenset({'propulsion'}), frozenset({_AIRFRAME})),
    _ENERGY,
    *_BLADE_WAYS,
)

_WATT_HOURS = number(0.001, 1e5, 'Wh')
_WATT_HOURS_OR_ITS = number(0.001, 1e5, 'Wh', word=_AIRFRAME)
_VOLT = number(0.1, 10_000, 'V')
_ONE_WAY = (
    'must be one way of three: energy_budget_kj, battery_wh, or battery_mah and battery_v; '
    'battery_usable_share goes with a battery alone'
)


class AirframeConfig(Section):
    """A craft with rotors that share its weight, as `config/airframes.yaml` explains."""

    mass_kg: Annotated[float, number(0.01, 1000, 'kg')]
    rotors: Annotated[int, whole(1, 64)]
    rotor_radius_m: Annotated[float, number(0.01, 20, 'm')]
    fuselage_drag_area_m2: Annotated[float, number(0, 20, 'm^2')]
    profile_drag: Annotated[float, number(0.001, 1)]
    induced_correction: Annotated[float, number(0, 5)]
    efficiency: Annotated[float, number(0.05, 1)]
    air_density_kgpm3: Annotated[float, number(0.1, 2, 'kg/m^3')]
    # How wide the blades are, and how fast: each in one of two ways.
    solidity: Annotated[float | None, number(0.001, 1)] = None
    blades: Annotated[int | None, whole(1, 16)] = None
    chord_m: Annotated[float | None, number(0.0001, 5, 'm')] = None
    tip_speed_mps: Annotated[float | None, number(1, 1000, 'm/s')] = None
    lift_coefficient: Annotated[float | None, number(0.01, 2)] = None
    max_speed_mps: Annotated[float | None, number(0.1, 200, 'm/s')] = None
    # The battery that comes with it, where that is known.
    battery_wh: Annotated[float | None, _WATT_HOURS] = None
    battery_v: Annotated[float | None, _VOLT] = None

    @property
    def propulsion(self) -> dict[str, float]:
        """The constants of its propulsion power, as a scenario's `propulsion` has them."""
        rotors = self._rotors
        return {
            'blade_profile_power_w': rotors.blade_profile_power_w,
            'induced_power_w': rotors.induced_power_w,
            'tip_speed_mps': rotors.tip_speed_mps,
            'induced_speed_mps': rotors.induced_speed_mps,
            'parasite_coefficient': rotors.parasite_coefficient,
        }

    def too_fast(self, speed_mps: object) -> str:
        """What is wrong with a speed [m/s]; nothing where it is no number, as others say so."""
        most_mps = self.max_speed_mps
        if most_mps is None or not isinstance(speed_mps, int | float) or speed_mps <= most_mps:
            return ''
        return (
            f'is {speed_mps:g}: must be at most {most_mps:g} m/s, the most that its airframe flies'
        )

    @property
    def _rotors(self) -> Rotors:
        disc_m2 = disc_area_m2(self.rotors, self.rotor_radius_m)
        weight_n, density = self.mass_kg * GRAVITY_MPS2, self.air_density_kgpm3
        solidity, tip_speed_mps = self.solidity, self.tip_speed_mps
        if self.blades is not None and self.chord_m is not None:
            solidity = solidity_of(self.blades, self.chord_m, self.rotor_radius_m)
        if solidity is not None and self.lift_coefficient is not None:
            lift = self.lift_coefficient
            tip_speed_mps = hover_tip_speed_mps(weight_n, disc_m2, solidity, lift, density)
        if solidity is None or tip_speed_mps is None:
            raise RuntimeError('an airframe without blades was not refused')
        return Rotors(
            weight_n=weight_n,
            disc_m2=disc_m2,
            solidity=solidity,
            tip_speed_mps=tip_speed_mps,
            profile_drag=self.profile_drag,
            induced_correction=self.induced_correction,
            drag_area_m2=self.fuselage_drag_area_m2,
            efficiency=self.efficiency,
            air_density_kgpm3=density,
        )


class _Battery(Section):
    """What a UAV's battery holds, one way or the other, and how much of that it may use."""

    battery_wh: Annotated[float | Literal['airframe'] | None, _WATT_HOURS_OR_ITS] = None
    battery_mah: Annotated[float | None, number(0.1, 1e8, 'mAh')] = None
    battery_v: Annotated[float | None, _VOLT] = None
    battery_usable_share: Annotated[float | None, number(0.01, 1)] = None

    def usable_wh(self, airframe: AirframeConfig | None) -> float | str:
        """How much of it is to be used [Wh], or what is wrong."""
        share = 1.0 if self.battery_usable_share is None else self.battery_usable_share
        if self.battery_wh == _AIRFRAME:
            of_airframe = None if airframe is None else airframe.battery_wh
            if of_airframe is None:
                return 'is airframe: must be a number of Wh, as no airframe says what it holds'
            return share * of_airframe
        if isinstance(self.battery_wh, float):
            return share * self.battery_wh
        if self.battery_mah is None or self.battery_v is None:
            return _ONE_WAY
        return share * self.battery_mah / 1e3 * self.battery_v

    def known(self, airframe: AirframeConfig | None) -> BatteryConfig:
        """What a scenario keeps of it besides the budget."""
        of_airframe = None if airframe is None else airframe.battery_v
        return BatteryConfig(
            usable_share=self.battery_usable_share, nominal_v=self.battery_v or of_airframe
        )


def airframe_names() -> tuple[str, ...]:
    """The names of the airframes that come with the package."""
    return tuple(name for name in _shipped() if name != _COMMON)


def airframe_named(name: str) -> AirframeConfig:
    """An airframe that comes with the package.

    Raises:
        ConfigError: there is none of that name.
    """
    document = layers.of_mapping({_AIRFRAME: name}, label='airframe')
    return _airframe_at(document, (_AIRFRAME,))


def with_airframes(document: Document) -> Document:
    """A scenario's document with each UAV's constants and budget in place of craft and battery.

    Raises:
        ConfigError: one line per problem.
    """
    uavs = document.at(('fleet', 'uavs'))
    if not isinstance(uavs, list | tuple):
        return document
    resolved: list[object] = []
    problems: list[str] = []
    aliases = dict(document.aliases)
    for index, uav in enumerate(uavs):
        try:
            resolved.append(_resolved(document, ('fleet', 'uavs', index), uav, aliases))
        except ConfigError as error:
            problems += error.lines
    if problems:
        raise ConfigError(*dict.fromkeys(problems))
    fleet = {**document.at(('fleet',)), 'uavs': resolved}
    return replace(document, values={**document.values, 'fleet': fleet}, aliases=aliases)


def _resolved(document: Document, keys: Keys, uav: object, aliases: dict[Keys, Keys]) -> object:
    """A UAV by its constants and its budget; `aliases` learn where these were written."""
    if not isinstance(uav, dict):
        return uav
    if wrong := [key for key in uav if isinstance(key, str) and key not in _UAV_KEYS]:
        what = f'is an unknown key: must be one of {", ".join(_UAV_KEYS)}'
        raise ConfigError(*(document.problem((*keys, key), what) for key in wrong))
    left = {key: it for key, it in uav.items() if key not in (_AIRFRAME, *_BATTERY_KEYS)}
    airframe = None
    if _AIRFRAME in uav:
        written: Keys = (*keys, _AIRFRAME)
        if 'propulsion' in uav:
            raise ConfigError(document.problem(written, 'is given: must not be beside propulsion'))
        airframe = _airframe_at(document, written)
        if problem := airframe.too_fast(uav.get('speed_mps')):
            raise ConfigError(document.problem((*keys, 'speed_mps'), problem))
        left['propulsion'] = airframe.propulsion
        aliases[*keys, 'propulsion'] = aliases.get(written, written)
    said = [key for key in _BATTERY_KEYS if key in uav]
    if not said:
        return left
    written = (*keys, said[0])
    is_twice = not {'energy_budget_kj', 'battery'}.isdisjoint(uav)
    if is_twice or {*said} - {_USABLE_SHARE} not in _BATTERIES:
        raise ConfigError(document.problem(written, _ONE_WAY))
    battery = validated(
        _Battery, _with_values(document, keys, {key: uav[key] for key in said}), keys
    )
    usable_wh = battery.usable_wh(airframe)
    if isinstance(usable_wh, str):
        raise ConfigError(document.problem(written, usable_wh))
    left['energy_budget_kj'] = usable_wh * KJ_PER_WH
    left['battery'] = battery.known(airframe).as_mapping() or None
    for key in ('energy_budget_kj', 'battery'):
        aliases[*keys, key] = aliases.get(written, written)
    return left


def _airframe_at(document: Document, keys: Keys) -> AirframeConfig:
    """The airframe that a document names or describes at a path."""
    given, shipped = document.at(keys), _shipped()
    described = given if isinstance(given, dict) else {'like': given}
    name = described.get('like', _COMMON)
    if (
        not isinstance(name, str)
        or name not in shipped
        or (name == _COMMON and 'like' in described)
    ):
        names = ', '.join(airframe_names())
        what = f'is {shown(name)}: must be a mapping, or one of {names}'
        raise ConfigError(document.problem((*keys, 'like') if given is described else keys, what))
    own = {key: value for key, value in described.items() if key != 'like'}
    base = layers.merged_mapping(shipped[_COMMON], shipped[name], _BLADE_WAYS)
    full = layers.merged_mapping(base, own, _BLADE_WAYS)
    airframe = validated(AirframeConfig, _with_values(document, keys, full), keys)
    if problems := [document.problem(keys, what) for what in _wrong_blades(airframe)]:
        raise ConfigError(*problems)
    return airframe


def _wrong_blades(airframe: AirframeConfig) -> Iterator[str]:
    has_both = airframe.blades is not None and airframe.chord_m is not None
    has_any = airframe.blades is not None or airframe.chord_m is not None
    if has_any != has_both or (airframe.solidity is None) != has_both:
        yield 'must say either solidity, or blades and chord_m'
    if (airframe.tip_speed_mps is None) == (airframe.lift_coefficient is None):
        yield 'must say either tip_speed_mps or lift_coefficient'


def _with_values(document: Document, keys: Keys, value: object) -> Document:
    """The document with nothing but a value at a path, whose lines it knows."""
    values: Any = value
    for key in reversed(keys):
        values = {key: values}
    return replace(document, values=values)


@cache
def _shipped() -> dict[str, dict[str, Any]]:
    """What comes with the package: what airframes have in common, and each by its name."""
    path = next(
        (folder / _FILE for folder in shared_folders('') if layers.is_file(folder / _FILE)),
        Path(_FILE),
    )
    return layers.parse(layers.read_text(path), label=str(path), folder=path.parent).values
