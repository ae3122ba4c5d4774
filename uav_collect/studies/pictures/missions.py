"""Draws fields and missions: the sensors with a mission's data, and the ways of policies."""

import numpy as np
from uav_collect import files
from uav_collect.analysis.area_picture import draw_closed, GREY
from uav_collect.analysis.metrics import mission_metrics
from uav_collect.analysis.trajectories import draw_mission
from uav_collect.recording.mission_folder import log_name
from uav_collect.recording.mission_log import from_jsonl, MissionLog
from uav_collect.scenario.site import build_site
from uav_collect.studies.findings import Findings
from uav_collect.studies.pictures.drawing import Drawing, label_axes, panels
from uav_collect.studies.study import TopologyStudy, TrajectoriesStudy
from uav_collect.uav.action_codes import ACTION_NAMES
from uav_collect.world.sensor_field import demand_of

_SIDE_IN = 4.6
_SIZE_IN = (5.0, 6.7)
_LOG_COLUMNS = (
    'decision', 'time_s', 'action', 'x_m', 'y_m', 'duration_s', 'energy_j', 'collected_bit',
)  # fmt: skip


def draw_topology(study: TopologyStudy) -> Drawing:
    """Draw where the sensors are, coloured by what they hold in a mission."""
    site = build_site(study.scenario)
    demand_mbit = demand_of(site, study.mission_seed) / 1e6
    n_active = int((demand_mbit > 0).sum())
    note = f'Fig. {study.figure} of the paper; mission seed {study.mission_seed}'
    figure, [[axes]] = panels(1, 1, study.title, note, size_in=(5.6, 4.6))
    east_m, north_m = site.position_m.T
    silent, active = demand_mbit == 0, demand_mbit > 0
    axes.scatter(
        east_m[silent], north_m[silent], 9, color=GREY, linewidths=0,
        label=f'without data ({int(silent.sum())} sensors)',
    )  # fmt: skip
    dots = axes.scatter(
        east_m[active], north_m[active], 16, c=demand_mbit[active], vmin=0.0, vmax=1.0,
        cmap='viridis', linewidths=0, label=f'with data ({n_active} sensors)',
    )  # fmt: skip
    figure.colorbar(dots, ax=axes, label='data [Mbit]')
    area = study.scenario.area
    draw_closed(axes, area)
    axes.set(xlim=(0.0, area.width_m), ylim=(0.0, area.height_m), aspect='equal')
    axes.set_xticks(np.arange(area.n_columns + 1) * area.cell_size_m)
    axes.set_yticks(np.arange(area.n_rows + 1) * area.cell_size_m)
    label_axes(axes, 'east [m]', 'north', 'm')
    axes.legend(
        loc='upper center', bbox_to_anchor=(0.5, -0.12), frameon=False, fontsize=8, ncols=2
    )
    cells = zip(site.sensor_ids, east_m.tolist(), north_m.tolist(), demand_mbit, strict=True)
    rows = [[name, x_m, y_m, float(data)] for name, x_m, y_m, data in cells]
    return Drawing(
        figure=figure, table=files.csv_of([('sensor', 'x_m', 'y_m', 'data_mbit'), *rows])
    )


def draw_trajectories(study: TrajectoriesStudy, findings: Findings) -> Drawing:
    """Draw one mission as each policy flew it.

    Raises:
        StoreError: a job of it is not done.
    """
    site = build_site(study.scenario)
    demand_bit = demand_of(site, study.mission_seed)
    note = f'Fig. {study.figure} of the paper; {study.about}; mission seed {study.mission_seed}'
    figure, [row] = panels(1, len(study.flown), study.title, note, size_in=_SIZE_IN)
    rows: list[list[object]] = []
    for axes, (label, digest) in zip(row, study.flown.items(), strict=True):
        log = from_jsonl(findings.file(digest, log_name(study.mission_seed)))
        handles = draw_mission(axes, log, site, demand_bit, _SIDE_IN)
        axes.set_title(_merits(label, log), fontsize=8.5)
        axes.legend(
            handles=handles, loc='upper center', bbox_to_anchor=(0.5, -0.13), frameon=False,
            fontsize=7.5, ncols=2,
        )  # fmt: skip
        rows += _rows(label, log)
    return Drawing(figure=figure, table=files.csv_of([('policy', 'uav', *_LOG_COLUMNS), *rows]))


def _merits(label: str, log: MissionLog) -> str:
    mission = mission_metrics(log)
    time = f'{mission.completion_s:.0f} s' if mission.is_finished else 'not finished'
    return f'{label} (1 mission): {time}, {mission.efficiency_kbit_per_j:.3f} kbit/J'


def _rows(label: str, log: MissionLog) -> list[list[object]]:
    return [
        [
            label,
            int(event['uav']),
            *(
                ACTION_NAMES[event[name]] if name == 'action' else event[name].item()
                for name in _LOG_COLUMNS
            ),
        ]
        for event in log.events
    ]
