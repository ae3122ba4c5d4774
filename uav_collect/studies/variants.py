"""The scenarios that studies compare: a field with one thing changed."""

from uav_collect.scenario.load import from_yaml, load, Scenario
from uav_collect.studies.scale import FieldConfig


def field_of(config: FieldConfig) -> Scenario:
    """The scenario that stands for one of the paper's areas.

    Raises:
        ConfigError: there is none of that name, or an override does not fit.
    """
    return load(config.scenario, config.set)


def with_budget(scenario: Scenario, budget_kj: float) -> Scenario:
    """Each UAV with another energy budget."""
    uavs = [uav.model_copy(update={'energy_budget_kj': budget_kj}) for uav in scenario.uavs]
    return _checked(scenario, fleet=scenario.fleet.model_copy(update={'uavs': tuple(uavs)}))


def with_density(scenario: Scenario, density: float) -> Scenario:
    """Another share of cells with data."""
    return _checked(scenario, demand=scenario.demand.model_copy(update={'cell_share': density}))


def with_range(scenario: Scenario, range_m: float) -> Scenario:
    """Another communication range."""
    return _checked(scenario, radio=scenario.radio.model_copy(update={'contact_range_m': range_m}))


def with_csi_error(scenario: Scenario, variance: float) -> Scenario:
    """Another channel estimation error, relative to the path gain."""
    changed = {'csi_error_variance': variance}
    return _checked(scenario, radio=scenario.radio.model_copy(update=changed))


def _checked(scenario: Scenario, **parts: object) -> Scenario:
    return from_yaml(scenario.model_copy(update=parts).to_yaml())
