"""What studies have in common: scenarios with one thing changed, trainings, what is compared."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

from uav_collect.scenario.load import from_yaml, load, with_uavs
from uav_collect.scenario.model import Scenario
from uav_collect.studies.requests import Requests
from uav_collect.studies.scale import FieldConfig
from uav_collect.studies.study import (
    AQMIX,
    CurvesPanel,
    LEARNED,
    Line,
    MissionSet,
    PLAN,
    RULES,
    TrainedPolicies,
    UNTRAINED,
)


def field_of(config: FieldConfig) -> Scenario:
    """The scenario that stands for one of the paper's areas.

    Raises:
        ConfigError: there is none of that name, or an override does not fit.
    """
    return load(config.scenario, config.set)


def with_budget(scenario: Scenario, budget_kj: float) -> Scenario:
    """The scenario with another energy budget for each UAV."""
    uavs = [replace(uav, energy_budget_kj=budget_kj) for uav in scenario.uavs]
    return _checked(replace(scenario, fleet=replace(scenario.fleet, uavs=tuple(uavs))))


def with_density(scenario: Scenario, density: float) -> Scenario:
    """The scenario with another share of cells that hold data."""
    return _checked(replace(scenario, demand=replace(scenario.demand, cell_share=density)))


def with_range(scenario: Scenario, range_m: float) -> Scenario:
    """The scenario with another communication range."""
    return _checked(replace(scenario, radio=replace(scenario.radio, contact_range_m=range_m)))


def with_csi_error(scenario: Scenario, variance: float) -> Scenario:
    """The scenario with another channel estimation error, relative to the path gain."""
    return _checked(replace(scenario, radio=replace(scenario.radio, csi_error_variance=variance)))


def with_link(scenario: Scenario, loss_share: float, delay_s: float) -> Scenario:
    """The scenario with messages between UAVs lost and late, by half the mean more or less."""
    late_s = (delay_s, 0.5 * delay_s)
    return _checked(
        replace(scenario, radio=replace(scenario.radio, loss_share=loss_share, delay_s=late_s))
    )


def _checked(scenario: Scenario) -> Scenario:
    return from_yaml(scenario.to_yaml())


def train_all(
    requests: Requests, scenario: Scenario, decisions: int, n_seeds: int
) -> dict[str, TrainedPolicies]:
    """Ask for the trainings of each algorithm on a scenario, by label."""
    return {label: requests.train(label, scenario, decisions, n_seeds) for label in LEARNED}


def train_usual(requests: Requests) -> dict[str, TrainedPolicies]:
    """Ask for the trainings of each algorithm on the usual field, by label."""
    config = requests.scale.fields.usual
    field = field_of(config)
    return train_all(requests, field, config.decisions, requests.scale.seeds.usual)


def fleets_of(requests: Requests) -> dict[int, tuple[Scenario, int, int]]:
    """By number of UAVs: the scenario, and the decisions and seeds of its trainings."""
    scale = requests.scale
    field = field_of(scale.fields.usual)
    fleets = {}
    for fleet in scale.fleets:
        scenario = with_uavs(field, fleet.n_uavs)
        is_usual = fleet.n_uavs == field.n_uavs and fleet.decisions == scale.fields.usual.decisions
        n_seeds = scale.seeds.usual if is_usual else scale.seeds.fleets
        fleets[fleet.n_uavs] = scenario, fleet.decisions, n_seeds
    return fleets


def make_area_panel(
    requests: Requests, label: str, config: FieldConfig, n_seeds: int
) -> CurvesPanel:
    """The panel of the trainings on one of the paper's areas."""
    field = field_of(config)
    trained = train_all(requests, field, config.decisions, n_seeds)
    return make_panel(requests, label, label.split()[0], field, trained)


def make_panel(
    requests: Requests,
    label: str,
    key: str,
    scenario: Scenario,
    trained: Mapping[str, TrainedPolicies],
) -> CurvesPanel:
    """The panel of some trainings, with policies and plans that need none as references."""
    # Policies are validated with equal bandwidth, so what stands beside them has it too.
    references = requests.references(scenario, 'equal')
    return CurvesPanel(label=label, key=key, curves=tuple(trained.values()), references=references)


def compare_trained_once(
    requests: Requests, scenarios: Sequence[Scenario], trained: Mapping[str, TrainedPolicies]
) -> tuple[Line, ...]:
    """Policies that were trained once, tested in each scenario."""
    return compare_trained_each(requests, scenarios, [trained] * len(scenarios))


def compare_trained_each(
    requests: Requests,
    scenarios: Sequence[Scenario],
    trained: Sequence[Mapping[str, TrainedPolicies]],
    planned: Scenario | None = None,
) -> tuple[Line, ...]:
    """Policies tested in each scenario, those trained for it.

    Args:
        planned: the one scenario that plans are made for, where what is varied means nothing to
            them.
    """
    pairs = [*zip(trained, scenarios, strict=True)]
    tests: dict[str, list[MissionSet]] = {
        label: [requests.fly(policies[label], scenario) for policies, scenario in pairs]
        for label in LEARNED
    }
    for label in RULES:
        tests[label] = [requests.fly_rule(label, scenario) for scenario in scenarios]
    tests[PLAN] = [requests.plan(planned or scenario) for scenario in scenarios]
    return tuple(
        Line(label=label, policy=label, tests=tuple(of_label)) for label, of_label in tests.items()
    )


def compare_bandwidths(requests: Requests, scenarios: Sequence[Scenario]) -> tuple[Line, ...]:
    """AQMIX's policy of the small field with optimal and with equal bandwidth, and the others."""
    scale = requests.scale
    config = scale.fields.small
    field = field_of(config)
    trained = requests.train(AQMIX, field, config.decisions, scale.seeds.small)
    lines = []
    for bandwidth, title in (('exact', 'optimal'), ('equal', 'equal')):
        tests = [requests.fly(trained, scenario, bandwidth) for scenario in scenarios]
        lines.append(
            Line(
                label=f'{AQMIX}, {title} bandwidth', policy=AQMIX, tests=tuple(tests),
                is_thin=bandwidth == 'equal',
            )
        )  # fmt: skip
    for label in RULES:
        tests = [requests.fly_rule(label, scenario) for scenario in scenarios]
        lines.append(Line(label=label, policy=label, tests=tuple(tests)))
    plans = [requests.plan(scenario) for scenario in scenarios]
    lines.append(Line(label=PLAN, policy=PLAN, tests=tuple(plans)))
    return tuple(lines)


def compare_links(requests: Requests, links: Sequence[tuple[float, float]]) -> tuple[Line, ...]:
    """What needs no training with each loss and delay [s]: the scenario's fleet, and one twice it.

    Raises:
        PolicyMismatchError: no policy is shipped for one of the fleets.
    """
    field = load(requests.scale.radio.scenario)
    lines = []
    for fleet in (field, with_uavs(field, 2 * field.n_uavs)):
        scenarios = [with_link(fleet, *link) for link in links]
        for label in UNTRAINED:
            tests = [requests.fly_untrained(label, scenario) for scenario in scenarios]
            is_larger = fleet is not field
            name = f'{label}, {fleet.n_uavs} UAVs' if is_larger else label
            lines.append(Line(label=name, policy=label, tests=tuple(tests), is_thin=is_larger))
    plans = [requests.plan(field)] * len(links)  # whoever knows all needs no radio
    return (*lines, Line(label=PLAN, policy=PLAN, tests=tuple(plans)))
