"""The paper's figures 3 to 13 (Sec. VII), and what it lacks: all runs, lost and late messages."""

from collections.abc import Callable, Mapping
from dataclasses import replace
import math

from uav_collect.scenario.model import Scenario
from uav_collect.studies.comparisons import (
    compare_bandwidths,
    compare_links,
    compare_trained_each,
    compare_trained_once,
    field_of,
    fleets_of,
    make_area_panel,
    make_panel,
    train_all,
    train_usual,
    with_budget,
    with_csi_error,
    with_density,
    with_range,
)
from uav_collect.studies.requests import Requests
from uav_collect.studies.scale import FieldConfig
from uav_collect.studies.study import (
    AQMIX,
    COLLECTED,
    COLLECTING,
    COMPLETION,
    CurvesPanel,
    CurvesStudy,
    EFFICIENCY,
    FINISHED,
    LinesStudy,
    PLAN,
    RULES,
    RunsStudy,
    Study,
    StudyTask,
    Suite,
    TopologyStudy,
    TrajectoriesStudy,
)

_Make = Callable[[Requests], Study]
_QMIX_ALONE = 'with one UAV QMIX is AQMIX, as nobody waits'
_OPTIMAL = 'the optimal bandwidth'
_LINKS_ABOUT = (
    'nothing is trained: strong is the shipped policy, which learned where no message is lost or'
    ' late; thin lines: twice as many UAVs, for which nothing is planned; optimal bandwidth'
)


def study_names() -> tuple[str, ...]:
    """The studies' names, in the order of the paper's figures, then those that it has not."""
    return tuple(_MAKERS)


def make_study(name: str, requests: Requests) -> Study:
    """A study, which asks for its jobs.

    Raises:
        ConfigError: a scenario or a setting of the scale does not fit.
        PolicyMismatchError: no policy is shipped for a scenario that takes one.
    """
    return _MAKERS[name](requests)


def _topology(requests: Requests) -> Study:
    scale = requests.scale
    return TopologyStudy(
        name='topology',
        figure=3,
        title='Sensors of the small field, and the data of one mission',
        about='nothing is flown',
        scenario=field_of(scale.fields.small),
        mission_seed=scale.tests.first_seed,
    )


def _learning_areas(requests: Requests) -> Study:
    fields, seeds = requests.scale.fields, requests.scale.seeds
    areas = (
        (fields.usual, seeds.usual),
        (fields.large, seeds.large),
        (fields.largest, seeds.largest),
    )
    panels = [make_area_panel(requests, _cells(field), field, n_seeds) for field, n_seeds in areas]
    trained_by = requests.trained_by(*(field.decisions for field, _ in areas))
    return CurvesStudy(
        name='learning-areas',
        figure=4,
        title='Learning on areas of different size',
        about=f'each algorithm is trained on each area, {trained_by}',
        panels=tuple(panels),
    )


def _learning_uavs(requests: Requests) -> Study:
    panels = []
    fleets = fleets_of(requests)
    for n_uavs, (scenario, decisions, n_seeds) in fleets.items():
        label = f'{n_uavs} UAV{"s" if n_uavs > 1 else ""}'
        trained = train_all(requests, scenario, decisions, n_seeds)
        panels.append(make_panel(requests, label, f'{n_uavs}_uavs', scenario, trained))
    return CurvesStudy(
        name='learning-uavs',
        figure=5,
        title='Learning with different numbers of UAVs',
        about=f'each algorithm is trained with each number of UAVs, {_trained(requests, fleets)};'
        f' {_QMIX_ALONE}',
        panels=tuple(panels),
    )


def _energy(requests: Requests) -> Study:
    scale = requests.scale
    field = field_of(scale.fields.usual)
    scenarios = [with_budget(field, budget_kj) for budget_kj in scale.budgets_kj]
    return LinesStudy(
        name='energy',
        figure=6,
        title='Energy budgets',
        about=f'trained with {field.uavs[0].energy_budget_kj:g} kJ, '
        f'{requests.trained_by(scale.fields.usual.decisions)};'
        f' tested with each budget and {_OPTIMAL}',
        over='energy budget of each UAV [kJ]',
        column='energy_budget_kj',
        values=scale.budgets_kj,
        names=tuple(f'{budget_kj:g}' for budget_kj in scale.budgets_kj),
        measures=(COLLECTED, COMPLETION, EFFICIENCY),
        lines=compare_trained_once(requests, scenarios, train_usual(requests)),
    )


def _density(requests: Requests) -> Study:
    scale = requests.scale
    field = field_of(scale.fields.usual)
    scenarios = [with_density(field, density) for density in scale.densities]
    return LinesStudy(
        name='density',
        figure=7,
        title='Density of the demand',
        about=f'trained at a density of {field.demand.cell_share:g}, '
        f'{requests.trained_by(scale.fields.usual.decisions)}; tested at each with {_OPTIMAL}',
        over='data density [data cells per cell]',
        column='density_share',
        values=scale.densities,
        measures=(COMPLETION, EFFICIENCY),
        lines=compare_trained_once(requests, scenarios, train_usual(requests)),
    )


def _uavs(requests: Requests) -> Study:
    fleets = fleets_of(requests)
    trained = [train_all(requests, *fleet) for fleet in fleets.values()]
    scenarios = [scenario for scenario, _, _ in fleets.values()]
    return LinesStudy(
        name='uavs',
        figure=8,
        title='Number of UAVs',
        about=f'each algorithm is trained with each number of UAVs, {_trained(requests, fleets)};'
        f' {_QMIX_ALONE}; tested with {_OPTIMAL}',
        over='number of UAVs',
        column='n_uavs',
        values=tuple(map(float, fleets)),
        measures=(COMPLETION, EFFICIENCY),
        lines=compare_trained_each(requests, scenarios, trained),
    )


def _range(requests: Requests) -> Study:
    scale = requests.scale
    field = field_of(scale.fields.usual)
    scenarios = [with_range(field, range_m) for range_m in scale.ranges_m]
    decisions, n_seeds = scale.fields.usual.decisions, scale.seeds.ranges
    trained = [train_all(requests, scenario, decisions, n_seeds) for scenario in scenarios]
    return LinesStudy(
        name='range',
        figure=9,
        title='Communication range',
        about=f'each algorithm is trained with each range, {requests.trained_by(decisions)};'
        f' tested with {_OPTIMAL}',
        over='communication range between UAVs [m]',
        column='contact_range_m',
        values=scale.ranges_m,
        names=tuple(map(_range_name, scale.ranges_m)),
        measures=(COMPLETION, EFFICIENCY),
        lines=compare_trained_each(requests, scenarios, trained, planned=field),
    )


def _kernel(requests: Requests) -> Study:
    scale = requests.scale
    config = scale.fields.large
    field = field_of(config)
    curves = [
        replace(
            requests.train(
                AQMIX, field, config.decisions, scale.seeds.kernels, mixer__pool_side=kernel
            ),
            label=f'{kernel}x{kernel}',
        )
        for kernel in scale.kernels
    ]
    references = requests.references(field, 'equal')
    panel = CurvesPanel(
        label=_cells(config), key=_cells(config).split()[0], curves=tuple(curves),
        references=references,
    )  # fmt: skip
    return CurvesStudy(
        name='kernel',
        figure=10,
        title='Learning of AQMIX with kernels of different size',
        about=f'AQMIX is trained with each kernel (mixer.pool_side) on {_cells(config)},'
        f' {requests.trained_by(config.decisions)}',
        panels=(panel,),
    )


def _csi(requests: Requests) -> Study:
    scale = requests.scale
    field = field_of(scale.fields.small)
    scenarios = [with_csi_error(field, error) for error in scale.csi_errors]
    return LinesStudy(
        name='csi',
        figure=11,
        title='Channel estimation error',
        about='trained on the small field with perfect channels, '
        f'{requests.trained_by(scale.fields.small.decisions)}; tested with each error',
        over='variance of the channel estimation error',
        column='csi_error_variance',
        values=scale.csi_errors,
        measures=(COLLECTING, EFFICIENCY),
        lines=compare_bandwidths(requests, scenarios),
    )


def _bandwidth(requests: Requests) -> Study:
    scale = requests.scale
    field = with_csi_error(field_of(scale.fields.small), scale.bandwidth_csi_error)
    scenarios = [with_density(field, density) for density in scale.densities]
    return LinesStudy(
        name='bandwidth',
        figure=12,
        title='Optimal and equal bandwidth over the density of the demand',
        about=f'trained on the small field with its own density and perfect channels, '
        f'{requests.trained_by(scale.fields.small.decisions)};'
        ' tested at each density with a channel estimation error of '
        f'{scale.bandwidth_csi_error:g}',
        over='data density [data cells per cell]',
        column='density_share',
        values=scale.densities,
        measures=(COLLECTING, EFFICIENCY),
        lines=compare_bandwidths(requests, scenarios),
    )


def _trajectories(requests: Requests) -> Study:
    scale = requests.scale
    config = scale.fields.small
    field = field_of(config)
    trained = train_all(requests, field, config.decisions, scale.seeds.small)
    seed = scale.tests.first_seed
    return TrajectoriesStudy(
        name='trajectories',
        figure=13,
        title='One mission as each learned policy flies it',
        about=f'each algorithm is trained on the small field, '
        f'{requests.trained_by(config.decisions)}; the best in validation flies, with {_OPTIMAL}',
        scenario=field,
        mission_seed=seed,
        flown={label: requests.log_mission(one, field, seed) for label, one in trained.items()},
        tests={label: requests.fly(one, field) for label, one in trained.items()},
    )


def _loss(requests: Requests) -> Study:
    shares = requests.scale.radio.loss_shares
    return LinesStudy(
        name='loss',
        figure=None,
        title='Messages between UAVs that are lost',
        about=_LINKS_ABOUT,
        over='share of messages between UAVs that is lost',
        column='loss_share',
        values=shares,
        measures=(COMPLETION, EFFICIENCY, FINISHED),
        lines=compare_links(requests, [(share, 0.0) for share in shares]),
    )


def _delay(requests: Requests) -> Study:
    delays_s = requests.scale.radio.delays_s
    return LinesStudy(
        name='delay',
        figure=None,
        title='Messages between UAVs that come late, each by half to one and a half of the mean',
        about=_LINKS_ABOUT,
        over='mean delay of messages between UAVs [s]',
        column='delay_s',
        values=delays_s,
        names=tuple(f'{delay_s:g}' for delay_s in delays_s),
        measures=(COMPLETION, EFFICIENCY, FINISHED),
        lines=compare_links(requests, [(0.0, delay_s) for delay_s in delays_s]),
    )


def _runs(requests: Requests) -> Study:
    fields, seeds = requests.scale.fields, requests.scale.seeds
    areas = (
        (fields.small, seeds.small),
        (fields.usual, seeds.usual),
        (fields.large, seeds.large),
        (fields.largest, seeds.largest),
    )
    of_areas = [
        _task(requests, _cells(field), field_of(field), field.decisions, n_seeds)
        for field, n_seeds in areas
    ]
    fleets = fleets_of(requests)
    of_fleets = [_task(requests, f'{n_uavs} UAVs', *fleet) for n_uavs, fleet in fleets.items()]
    decisions = [field.decisions for field, _ in areas]
    decisions += [n_decisions for _, n_decisions, _ in fleets.values()]
    return RunsStudy(
        name='runs',
        figure=None,
        title='Algorithms over all areas and over all fleets, training by training',
        about=f'each algorithm is trained for each task, {requests.trained_by(*decisions)};'
        f' {_QMIX_ALONE}; tested with {_OPTIMAL}',
        suites=(
            Suite(label='areas', key='areas', tasks=tuple(of_areas)),
            Suite(label='fleets', key='fleets', tasks=tuple(of_fleets)),
        ),
    )


def _task(
    requests: Requests, label: str, scenario: Scenario, decisions: int, n_seeds: int
) -> StudyTask:
    trained = train_all(requests, scenario, decisions, n_seeds)
    tests = {name: requests.fly(it, scenario) for name, it in trained.items()}
    tests |= {rule: requests.fly_rule(rule, scenario) for rule in RULES}
    tests[PLAN] = requests.plan(scenario)
    key = f'{scenario.name}_n{scenario.n_uavs}'
    return StudyTask(label=label, key=key, trained=trained, tests=tests)


_MAKERS: Mapping[str, _Make] = {
    'topology': _topology,
    'learning-areas': _learning_areas,
    'learning-uavs': _learning_uavs,
    'energy': _energy,
    'density': _density,
    'uavs': _uavs,
    'range': _range,
    'kernel': _kernel,
    'csi': _csi,
    'bandwidth': _bandwidth,
    'trajectories': _trajectories,
    'runs': _runs,
    'loss': _loss,
    'delay': _delay,
}


def _trained(requests: Requests, fleets: Mapping[int, tuple[Scenario, int, int]]) -> str:
    return requests.trained_by(*(decisions for _, decisions, _ in fleets.values()))


def _cells(config: FieldConfig) -> str:
    area = field_of(config).area
    return f'{area.n_rows}x{area.n_columns} cells'


def _range_name(range_m: float) -> str:
    if range_m == 0.0:
        return 'none'
    return 'full' if math.isinf(range_m) else f'{range_m:g}'
