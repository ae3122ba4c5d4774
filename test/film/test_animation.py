"""Films of missions as GIF and MP4, frame by frame."""

from collections.abc import Sequence
from dataclasses import replace
import math
from pathlib import Path
import shutil

from matplotlib.colors import to_rgb
import numpy as np
from numpy.typing import NDArray
from PIL import Image
from processes import completed
import pytest
from scripted_logs import fly, header, uav
from tiny_world import tiny
from tiny_world import uav as in_fleet
from uav_collect.__main__ import main
from uav_collect.analysis.area_picture import BLACK, GREY, NO_FLY
from uav_collect.analysis.trajectories import COLOURS
from uav_collect.errors import FilmError
from uav_collect.film import animation
from uav_collect.film.animation import Film, film_of, write_gif, write_mp4
from uav_collect.missions.rollout import fly as fly_policy
from uav_collect.scenario.site import build_site

# Cell A of the tiny world, with its sensor, is one move to the right of the start.
TO_A = ('right', 'hover 4 0.5', 'right', 'left', 'home')
ASIDE = ('forward', 'forward', 'home')


def film(*scripts: Sequence[str]) -> Film:
    site = build_site(tiny(*(in_fleet(10.0) for _ in scripts)))
    head = header([uav(number) for number in range(1, len(scripts) + 1)])
    return film_of(fly(head, scripts), site, np.array([1e6, 0.0, 0.0]))


def shows(film: Film, time_s: float, place_m: tuple[float, float], colour: str) -> bool:
    """Whether a frame has a colour near a place."""
    pixels = film.picture.at(time_s)
    x_px, y_px = film.picture._map.transData.transform(place_m)
    row, column = round(pixels.shape[0] - y_px), round(x_px)
    near: NDArray[np.uint8] = pixels[row - 6 : row + 7, column - 6 : column + 7, :3]
    wanted = np.array([round(255 * part) for part in to_rgb(colour)])
    return bool((near == wanted).all(axis=-1).any())


def test_a_frame_shows_each_uav_where_it_is() -> None:
    flown = film(TO_A, ASIDE)
    assert shows(flown, 2.5, (50.0, 25.0), COLOURS[0])
    assert shows(flown, 2.5, (25.0, 50.0), COLOURS[1])
    assert shows(flown, 7.5, (25.0, 100.0), COLOURS[1])
    assert not shows(flown, 2.5, (25.0, 100.0), COLOURS[1])


def test_a_frame_does_not_show_a_uav_where_the_log_lacks_what_it_did() -> None:
    site = build_site(tiny(in_fleet(10.0)))
    log = fly(header([uav(1)]), [('forward', 'forward', 'right', 'home')])
    lacking = replace(log, events=np.delete(log.events, 1))
    for flown, is_shown in ((log, True), (lacking, False)):
        whole = film_of(flown, site, np.array([1e6, 0.0, 0.0]))
        assert shows(whole, 7.5, (25.0, 100.0), COLOURS[0]) == is_shown
        assert shows(whole, 12.5, (50.0, 125.0), COLOURS[0])
        assert shows(whole, 20.0, (25.0, 100.0), COLOURS[0]) == is_shown  # of its trail


def test_a_sensor_is_black_until_its_data_is_there() -> None:
    flown, place_m = film(ASIDE, TO_A), (75.0, 25.0)
    assert shows(flown, 4.0, place_m, BLACK)
    assert not shows(flown, 20.0, place_m, BLACK)
    assert shows(flown, 20.0, (125.0, 125.0), GREY)  # it never had any


def test_no_fly_zones_and_the_boundary_are_outlined() -> None:
    zone_m = [(60.0, 110.0), (90.0, 110.0), (70.0, 140.0)]
    edge_m = [(0.0, 0.0), (150.0, 0.0), (150.0, 200.0), (0.0, 200.0)]
    site = build_site(tiny(in_fleet(10.0), area__no_fly=[zone_m], area__boundary=edge_m))
    flown = film_of(fly(header([uav(1)]), [ASIDE]), site, np.zeros(3))
    assert shows(flown, 1.0, (75.0, 110.0), NO_FLY)
    assert shows(flown, 1.0, (150.0, 175.0), BLACK)
    assert not shows(flown, 1.0, (175.0, 25.0), NO_FLY)


def test_an_edge_beyond_the_cells_is_shown_and_explained() -> None:
    edge_m = [(-60.0, -30.0), (220.0, -20.0), (260.0, 230.0), (-10.0, 225.0)]
    site = build_site(tiny(in_fleet(10.0), area__boundary=edge_m))
    flown = film_of(fly(header([uav(1)]), [ASIDE]), site, np.zeros(3))
    for corner_m in edge_m:
        assert shows(flown, 1.0, corner_m, BLACK)
    legend = flown.picture._bars.get_legend()
    assert legend is not None
    said = [text.get_text() for text in legend.get_texts()]
    assert {'in radio contact', "area's edge", 'sensor whose data waits'} < {*said}


def test_a_gif_has_all_frames_and_plays_again(tmp_path: Path) -> None:
    flown, drawn = film(ASIDE), list[int]()
    write_gif(flown, tmp_path / 'film.gif', drawn.append)
    assert sum(drawn) == flown.n_frames == 1 + math.ceil(flown.picture.end_s)
    with Image.open(tmp_path / 'film.gif') as gif:
        assert (gif.n_frames, gif.size, gif.info['loop']) == (
            flown.n_frames,
            flown.picture.size,
            0,
        )
        first = np.asarray(gif.convert('RGB')).astype(int)
        apart = np.abs(first - flown.picture.at(0.0)[..., :3])
        assert (apart > 48).mean() < 1e-4  # by its fewer colours


def test_however_long_a_mission_is_its_film_is_not() -> None:
    flown = film(['hover 4000 0.5', 'home'])
    assert flown.n_frames == animation._MOST_FRAMES
    assert flown.times_s[-1] == flown.picture.end_s == 4000.0


def test_a_mission_without_events_is_one_frame(tmp_path: Path) -> None:
    log = fly(header([uav(1)]), [ASIDE])
    none = replace(log, events=log.events[:0])
    still = film_of(none, build_site(tiny(in_fleet(10.0))), np.zeros(3))
    write_gif(still, tmp_path / 'film.gif', lambda _: None)
    with Image.open(tmp_path / 'film.gif') as gif:
        assert gif.n_frames == 1


@pytest.mark.skipif(shutil.which('ffprobe') is None, reason='ffmpeg is not installed')
@pytest.mark.usefixtures('few_frames')
def test_an_mp4_has_all_frames(tmp_path: Path) -> None:
    flown, path = film(ASIDE), tmp_path / 'film.mp4'
    write_mp4(flown, path, lambda _: None)
    words = ('ffprobe', '-v', 'error', '-count_frames', '-of', 'csv=p=0', '-show_entries')
    said = completed(*words, 'stream=width,height,nb_read_frames', path).stdout
    n_last = round(animation._LAST_S / animation._FRAME_S)
    width, height = flown.picture.size
    assert said.split() == [f'{width},{height},{flown.n_frames + n_last}']


@pytest.mark.skipif(shutil.which('ffmpeg') is None, reason='ffmpeg is not installed')
def test_what_ffmpeg_cannot_do_is_said_in_its_words(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(animation, '_FRAME_S', math.inf)  # of which it makes no film
    with pytest.raises(FilmError, match=r'^ffmpeg failed with exit status \d+: .'):
        write_mp4(film(ASIDE), tmp_path / 'film.mp4', lambda _: None)
    assert not [*tmp_path.iterdir()]


@pytest.fixture
def few_frames(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(animation, '_MOST_FRAMES', 4)


@pytest.fixture
def run_folder(tmp_path: Path) -> Path:
    scenario = tiny()
    for seed in (3, 4):
        [log] = fly_policy(build_site(scenario), [seed], 'sweep', 'exact')
        (tmp_path / f'mission_{seed}.jsonl').write_bytes(log.to_jsonl())
    (tmp_path / 'scenario.yaml').write_text(scenario.to_yaml())
    return tmp_path


@pytest.mark.usefixtures('few_frames')
def test_report_makes_a_film_of_a_log(
    run_folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = run_folder / 'film.gif'
    assert main(['report', str(run_folder / 'mission_3.jsonl'), '--gif', str(path)]) == 0
    assert path.read_bytes().startswith(b'GIF89a')
    assert f'film: {path}' in capsys.readouterr().err


@pytest.mark.parametrize('option', ['--gif', '--mp4'])
def test_a_film_that_cannot_be_made_is_refused_before_any_work(
    option: str,
    run_folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setenv('PATH', '')
    assert main(['report', str(run_folder), option, str(run_folder / 'film')]) == 2
    shown = capsys.readouterr()
    assert shown.out == ''
    assert shown.err.count('\n') == 1
    why = {
        '--gif': f'a film shows one mission, {run_folder} holds 2: PATH must be the log of one',
        '--mp4': 'ffmpeg is missing, which MP4 needs: apt install ffmpeg, or make a GIF instead',
    }
    assert shown.err == f'error: {why[option]}\n'
