"""The picture of a mission, and the lanes it draws paths in."""

from collections.abc import Callable
from dataclasses import dataclass, replace
import io
import itertools

from matplotlib.axes import Axes
from matplotlib.figure import Figure
import numpy as np
import pytest
from scripted_logs import fly, header, uav
from uav_collect.analysis import trajectories
from uav_collect.analysis.trajectories import corners_m, lane_shifts, narrowest_lane, steps
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
        cells=scenario.area.cells_per_side,
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


def legend_of(axes: Axes) -> list[str]:
    legend = axes.get_legend()
    assert legend is not None
    return [text.get_text() for text in legend.get_texts()]


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
    row, column = divmod(int(left.site.cell[0]), left.site.scenario.area.cells_per_side)
    there = ['right'] * column + ['forward'] * row
    served = scene(1, [[*there, f'hover 3 {left.demand_bit.sum() / 1e6}', 'home']])
    assert 'data left behind' in legend_of(drawn(left))
    assert 'data left behind' not in legend_of(drawn(served))
    for one, n_marks in ((left, int((left.demand_bit > 0).sum())), (served, 0)):
        rings = [mark for mark in drawn(one).collections if mark.get_zorder() == 7]
        assert [len(mark.get_offsets()) for mark in rings] == [n_marks]


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


# Lanes. Places are corners of a unit grid.


def way(*places: tuple[int, int]) -> Floats:
    return np.array(places, dtype=np.float64)


EAST = way((0, 0), (1, 0), (2, 0))


def test_a_way_alone_runs_through_the_centres() -> None:
    assert lane_shifts([EAST]) == [[0.0, 0.0]]
    np.testing.assert_array_equal(corners_m(EAST, [0.0, 0.0], 1.0)[[0, -1]], EAST[[0, -1]])


def test_hovering_takes_no_step() -> None:
    hovering = way((0, 0), (0, 0), (1, 0), (1, 0), (1, 0))
    assert [tuple(there) for _, there in steps(hovering)] == [(1.0, 0.0)]
    assert lane_shifts([hovering]) == [[0.0]]


@pytest.mark.parametrize('n_ways', [2, 3, 16])
def test_ways_along_one_edge_get_lanes_of_their_own(n_ways: int) -> None:
    shifts = [shift for shift, _ in lane_shifts([EAST] * n_ways)]
    gaps = np.diff(sorted(shifts))
    np.testing.assert_allclose(gaps, narrowest_lane([EAST] * n_ways), rtol=1e-12)
    assert sum(shifts) == pytest.approx(0.0, abs=1e-12)
    assert max(shifts) < 0.5  # inside the cell


def test_a_way_there_and_back_gets_two_lanes() -> None:
    there_and_back = way((0, 0), (1, 0), (0, 0))
    ((out, back),) = lane_shifts([there_and_back])
    assert out == -back != 0.0


def test_ways_that_only_cross_keep_to_the_centres() -> None:
    north = way((1, -1), (1, 0), (1, 1))
    assert lane_shifts([EAST, north]) == [[0.0, 0.0], [0.0, 0.0]]


def test_a_turn_joins_both_lanes_in_one_corner() -> None:
    corner = corners_m(10 * way((0, 0), (1, 0), (1, 1)), [0.1, -0.2], 10.0)
    np.testing.assert_allclose(corner, [[0, 1], [8, 1], [8, 10]], atol=1e-12)


def test_a_changed_lane_is_a_jog_within_the_cell() -> None:
    corners = corners_m(EAST, [0.0, 0.2], 1.0)
    np.testing.assert_allclose(corners, [[0, 0], [0.9, 0], [1.1, 0.2], [2, 0.2]], atol=1e-12)


def test_a_uav_that_never_moved_has_one_corner() -> None:
    np.testing.assert_array_equal(corners_m(way((3, 4), (3, 4)), [], 1.0), [[3, 4]])
    assert corners_m(np.empty((0, 2)), [], 1.0).shape == (0, 2)


def test_lanes_stay_in_order_along_a_shared_corridor() -> None:
    others = [EAST, EAST + 0.0]
    for first, second in itertools.pairwise(zip(*lane_shifts(others), strict=True)):
        assert first == second
