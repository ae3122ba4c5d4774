"""The picture of a mission."""

from collections.abc import Callable
from dataclasses import dataclass, replace
import io

from matplotlib.axes import Axes
from matplotlib.figure import Figure
import numpy as np
from pictures import legend_of
import pytest
from scripted_logs import fly, header, uav
from tiny_world import tiny
from tiny_world import uav as in_fleet
from uav_collect.analysis import trajectories
from uav_collect.kernels.arrays import Floats
from uav_collect.missions import rollout
from uav_collect.recording.mission_log import MissionLog
from uav_collect.scenario.load import load, with_uavs
from uav_collect.scenario.site import build_site, Site

PNG = b'\x89PNG\r\n\x1a\n'


@dataclass(frozen=True, kw_only=True)
class Scene:
    """What a picture is drawn of."""

    log: MissionLog
    site: Site
    demand_bit: Floats

    def draw(self) -> bytes:
        file = io.BytesIO()
        trajectories.trajectories(self.log, self.site, self.demand_bit, file)
        return file.getvalue()


def scene(n_uavs: int, scripts: list[list[str]], *, name: str = 'paper_8x8') -> Scene:
    """A scripted mission over the sensors of a scenario; data waits in their first cell alone."""
    scenario = with_uavs(load(name), n_uavs)
    site = build_site(scenario)
    demand_bit = np.where(site.cell == site.cell[0], 1e5, 0.0)
    head = header(
        [uav(number) for number in range(1, n_uavs + 1)],
        total_bit=float(demand_bit.sum()),
        cells=scenario.area.n_rows,
    )
    head = replace(head, cell_size_m=scenario.area.cell_size_m)
    return Scene(log=fly(head, scripts), site=site, demand_bit=demand_bit)


@pytest.fixture
def drawn(monkeypatch: pytest.MonkeyPatch) -> Callable[[Scene], Axes]:
    """Draws a scene and gives what was drawn instead of a file."""

    def draw(of: Scene) -> Axes:
        figures: list[Figure] = []
        monkeypatch.setattr(Figure, 'savefig', lambda self, *_, **__: figures.append(self))
        of.draw()
        return figures[0].axes[0]

    return draw


HOME = ['right', 'home']


def test_the_same_mission_gives_the_same_bytes() -> None:
    one = scene(2, [['right', 'hover 3 0.1', 'home'], ['forward', 'home']])
    assert one.draw() == one.draw()
    assert one.draw().startswith(PNG)


def test_the_picture_has_150_dots_per_inch_and_tells_no_software() -> None:
    content = scene(1, [HOME]).draw()
    assert b'pHYs' + (5906).to_bytes(4, 'big') * 2 in content  # per metre
    assert b'Software' not in content


@pytest.mark.parametrize(
    ('name', 'n_uavs', 'policy'),
    [('paper_8x8', 1, 'sweep'), ('lillgrund', 3, 'hert'), ('paper_20x20', 16, 'sweep')],
)
def test_every_scenario_and_fleet_can_be_drawn(name: str, n_uavs: int, policy: str) -> None:
    site = build_site(with_uavs(load(name), n_uavs))
    (log,) = rollout.fly(site, [1], policy, 'exact')
    one = Scene(log=log, site=site, demand_bit=np.zeros(site.n_sensors))
    assert one.draw().startswith(PNG)


@pytest.mark.parametrize('n_events', [0, 1, 2, 3])
def test_a_mission_cut_short_can_be_drawn(n_events: int, drawn: Callable[[Scene], Axes]) -> None:
    one = scene(2, [HOME, ['forward', 'hover 1 0', 'home']])
    one = replace(one, log=replace(one.log, events=one.log.events[:n_events]))
    axes = drawn(one)
    assert 'not finished' in ' '.join(text.get_text() for text in axes.texts)


def test_the_title_tells_the_figures_of_merit(drawn: Callable[[Scene], Axes]) -> None:
    one = scene(1, [['right', 'hover 4 0.5', 'home']])
    one = replace(one, log=replace(one.log, header=replace(one.log.header, total_bit=1e6)))
    words = ' '.join(text.get_text() for text in drawn(one).texts)
    assert 'scripted, mission seed 3: script' in words
    assert '0.50 of 1.00 Mbit (50.0 %) · 1.8 kJ · 14 s · 0.278 kbit/J' in words


def test_axes_are_the_area_in_metres_at_one_scale(drawn: Callable[[Scene], Axes]) -> None:
    axes = drawn(scene(1, [HOME], name='paper_10x10'))
    assert axes.get_xlim() == axes.get_ylim() == (0.0, 500.0)
    assert axes.get_aspect() == 1.0
    assert (axes.get_xlabel(), axes.get_ylabel()) == ('east [m]', 'north [m]')
    assert axes.get_xticks()[-1] == 500.0


EDGE_M = [(-60.0, -30.0), (220.0, -20.0), (260.0, 230.0), (-10.0, 225.0)]
ZONE_M = [(60.0, 110.0), (90.0, 110.0), (70.0, 140.0)]


def test_of_a_field_the_whole_edge_zones_and_names_are_drawn(
    drawn: Callable[[Scene], Axes],
) -> None:
    site = build_site(tiny(in_fleet(), area__boundary=EDGE_M, area__no_fly=[ZONE_M]))
    axes = drawn(Scene(log=fly(header([uav(1)]), [HOME]), site=site, demand_bit=np.zeros(3)))
    rings = [[*zip(*line.get_data(), strict=True)] for line in axes.get_lines()]
    assert [*EDGE_M, EDGE_M[0]] in rings
    assert [*ZONE_M, ZONE_M[0]] in rings
    for east_m, north_m in EDGE_M:
        assert axes.get_xlim()[0] < east_m < axes.get_xlim()[1]
        assert axes.get_ylim()[0] < north_m < axes.get_ylim()[1]
    assert {"area's edge", 'no-fly zone', 'closed cell'} < {*legend_of(axes)}
    assert {'S1', 'S2', 'S3'} < {text.get_text() for text in axes.texts}


def test_sensors_that_were_drawn_have_no_names_in_the_picture(
    drawn: Callable[[Scene], Axes],
) -> None:
    of = scene(1, [HOME])
    assert not {*of.site.sensor_ids} & {text.get_text() for text in drawn(of).texts}
    assert 'no-fly zone' not in legend_of(drawn(of))


def test_the_legend_names_every_uav(drawn: Callable[[Scene], Axes]) -> None:
    names = legend_of(drawn(scene(3, [HOME, HOME, HOME])))
    assert names[:3] == [f'UAV {number}: 10 m/s, 1.0 kJ' for number in (1, 2, 3)]


def test_no_two_of_sixteen_uavs_look_the_same(drawn: Callable[[Scene], Axes]) -> None:
    axes = drawn(scene(16, [HOME] * 16))
    legend = axes.get_legend()
    assert legend is not None
    looks = {(line.get_color(), str(line._dash_pattern)) for line in legend.get_lines()[:16]}
    assert len(looks) == 16


def test_data_left_behind_is_marked_and_explained(drawn: Callable[[Scene], Axes]) -> None:
    left = scene(1, [HOME])
    row, column = divmod(int(left.site.cell[0]), left.site.scenario.area.n_columns)
    there = ['right'] * column + ['forward'] * row
    served = scene(1, [[*there, f'hover 3 {left.demand_bit.sum() / 1e6}', 'home']])
    assert 'data left behind' in legend_of(drawn(left))
    assert 'data left behind' not in legend_of(drawn(served))
    for one, n_marks in ((left, int((left.demand_bit > 0).sum())), (served, 0)):
        rings = [mark for mark in drawn(one).collections if mark.get_zorder() == 7]
        assert [len(mark.get_offsets()) for mark in rings] == [n_marks]


def test_no_data_is_marked_that_may_have_been_read_in_an_event_that_is_missing(
    drawn: Callable[[Scene], Axes],
) -> None:
    left = scene(1, [['right', 'right', 'home']])
    gappy = replace(left, log=replace(left.log, events=np.delete(left.log.events, 1)))
    assert 'data left behind' not in legend_of(drawn(gappy))
    assert [len(it.get_offsets()) for it in drawn(gappy).collections if it.get_zorder() == 7] == [
        0
    ]


def test_an_end_that_was_not_recorded_is_not_said_to_be_none(
    drawn: Callable[[Scene], Axes],
) -> None:
    flown = scene(2, [['right', 'home'], ['right', 'right', 'home']])
    texts = {}
    for n_lost, event in enumerate((None, 2)):
        events = flown.log.events if event is None else np.delete(flown.log.events, event)
        axes = drawn(replace(flown, log=replace(flown.log, events=events)))
        texts[n_lost] = ' '.join(text.get_text() for text in axes.texts)
    assert 'end not recorded' not in texts[0]
    assert 'end not recorded' in texts[1]


def test_start_and_home_have_marks_of_their_own_where_they_differ(
    drawn: Callable[[Scene], Axes],
) -> None:
    one = scene(1, [HOME])
    assert 'start and home' in legend_of(drawn(one))
    elsewhere = load('paper_8x8', {'fleet.default.home': {'cell': [7, 7]}})
    names = legend_of(drawn(replace(one, site=build_site(with_uavs(elsewhere, 1)))))
    assert {'start', 'home'} <= set(names)


def test_demand_of_another_site_is_refused() -> None:
    one = scene(1, [HOME])
    with pytest.raises(ValueError, match='demand_bit must have shape'):
        replace(one, demand_bit=one.demand_bit[:-1]).draw()
