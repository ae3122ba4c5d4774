"""How large studies are: frozen models; values live in config/studies/*.yaml.

config/studies/paper.yaml says what each one means.
"""

import math
from pathlib import Path
from typing import Annotated, Any

from uav_collect.config import layers
from uav_collect.config.installed import shared_folders
from uav_collect.config.rules import Entries, name, number, Section, text, validated, whole
from uav_collect.errors import ConfigError
from uav_collect.limits import MAX_DECISIONS, MAX_SEED, MAX_UAVS

_Count = Annotated[int, whole(1, 1000)]
_Decisions = Annotated[int, whole(1, MAX_DECISIONS)]
_Several = Entries(2)


class FieldConfig(Section):
    """The scenario that stands for one of the paper's areas, and how long is trained on it."""

    scenario: Annotated[str, text(4096)]
    set: dict[str, Any]  # overrides of the scenario, by dotted path
    decisions: _Decisions  # that a policy learns from


class FieldsConfig(Section):
    """The paper's areas."""

    small: FieldConfig
    usual: FieldConfig
    large: FieldConfig
    largest: FieldConfig


class FleetSizeConfig(Section):
    """A number of UAVs on the usual field."""

    n_uavs: Annotated[int, whole(1, MAX_UAVS)]
    decisions: _Decisions


class SeedsConfig(Section):
    """How many trainings of a kind there are, seeds 0, 1, ..."""

    usual: _Count
    small: _Count
    large: _Count
    largest: _Count
    fleets: _Count
    ranges: _Count
    kernels: _Count


class TrainingsConfig(Section):
    """The preset that policies are trained by."""

    preset: Annotated[str, text(4096)]
    set: dict[str, Any]  # overrides of the preset, by dotted path


class TestsConfig(Section):
    """How many missions test a policy, from which seed on, in how many jobs."""

    first_seed: Annotated[int, whole(0, MAX_SEED)]
    missions: Annotated[int, whole(1, 100_000)]
    missions_per_job: Annotated[int, whole(1, 100_000)]
    plan_rounds: Annotated[int, whole(0, 10**9)]


class LinksConfig(Section):
    """Links between UAVs that shipped policies and rules are tested with."""

    scenario: Annotated[str, text(4096)]
    loss_shares: Annotated[tuple[Annotated[float, number(0, 1)], ...], _Several]
    delays_s: Annotated[tuple[Annotated[float, number(0, 3600, 's')], ...], _Several]


class ScaleConfig(Section):
    """Everything that makes studies large or small."""

    name: Annotated[str, name()]
    fields: FieldsConfig
    trainings: TrainingsConfig
    tests: TestsConfig
    seeds: SeedsConfig
    fleets: Annotated[tuple[FleetSizeConfig, ...], _Several]
    budgets_kj: Annotated[tuple[Annotated[float, number(0.001, 1e6, 'kJ')], ...], _Several]
    densities: Annotated[tuple[Annotated[float, number(1e-9, 1)], ...], _Several]
    ranges_m: Annotated[tuple[Annotated[float, number(0, math.inf, 'm')], ...], _Several]
    kernels: Annotated[tuple[Annotated[int, whole(1, 64)], ...], _Several]
    csi_errors: Annotated[tuple[Annotated[float, number(0, 1)], ...], _Several]
    bandwidth_csi_error: Annotated[float, number(0, 1)]
    radio: LinksConfig
    measured_s: Annotated[float, number(0, 3600, 's')]


def load_scale(name_or_path: str | Path) -> ScaleConfig:
    """Read a scale by its name among the shipped ones, or by the path of a YAML file.

    Raises:
        ConfigError: one line per problem: file and line, key, value, what is allowed.
    """
    document = layers.load(name_or_path, shared_folders('studies'), field='scale')
    scale = validated(ScaleConfig, document)
    _check_rising(scale, document.top.label)
    return scale


def _check_rising(scale: ScaleConfig, path: str) -> None:
    """Every line of a figure runs from the smallest value to the largest."""
    keys = ('budgets_kj', 'densities', 'ranges_m', 'kernels', 'csi_errors')
    varied = {key: getattr(scale, key) for key in keys} | {
        'radio.loss_shares': scale.radio.loss_shares,
        'radio.delays_s': scale.radio.delays_s,
    }
    for key, values in varied.items():
        if list(values) != sorted(set(values)):
            raise ConfigError(f'{path}: {key} is {list(values)}: must rise')
    n_uavs = [fleet.n_uavs for fleet in scale.fleets]
    if n_uavs != sorted(set(n_uavs)):
        raise ConfigError(f'{path}: fleets have {n_uavs} UAVs: must rise')
