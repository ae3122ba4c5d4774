"""A film of a mission as GIF or MP4: who flies where, who reads what, how much energy is left.

Most of a frame is that of the frame before: a film of any mission takes about a megabyte.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from io import BytesIO
import math
from pathlib import Path
import shutil
import subprocess
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageColor
from uav_collect import files
from uav_collect.errors import FilmError, in_one_line
from uav_collect.film.moving_picture import MEANT, MovingPicture, Pixels
from uav_collect.kernels.arrays import Floats, Ints
from uav_collect.recording.mission_log import MissionLog
from uav_collect.scenario.site import Site

_MOST_FRAMES = 180  # however long the mission is
_LEAST_STEP_S = 1.0  # simulated, from one frame to the next
_FRAME_S = 0.08  # of the film
_LAST_S = 2.0  # how long it shows the end
_N_COLOURS = 128  # of a GIF's palette
_SAMPLED = (0.0, 0.25, 0.5, 0.75, 1.0)  # of the mission: frames that the palette is made for
_FFMPEG = 'ffmpeg'
_REMEDY = 'apt install ffmpeg, or make a GIF instead'

Advance = Callable[[int], None]  # gets how many more frames are drawn


@dataclass(frozen=True, kw_only=True)
class Film:
    """A mission as frames, which are drawn when they are asked for."""

    picture: MovingPicture
    times_s: Floats  # (F,) simulated, of each frame

    @property
    def n_frames(self) -> int:
        """How many there are."""
        return len(self.times_s)

    def frames(self, advance: Advance) -> Iterator[Pixels]:
        """The frames, one after the other; each is valid until the next one is drawn."""
        for time_s in self.times_s:
            yield self.picture.at(float(time_s))
            advance(1)


def film_of(log: MissionLog, site: Site, demand_bit: Floats) -> Film:
    """The film of a mission, as for `MovingPicture`."""
    picture = MovingPicture(log, site, demand_bit)
    n_frames = min(_MOST_FRAMES, 1 + math.ceil(picture.end_s / _LEAST_STEP_S))
    return Film(picture=picture, times_s=np.linspace(0.0, picture.end_s, n_frames))


def write_gif(film: Film, path: Path, advance: Advance) -> None:
    """Write a film as GIF, which plays again and again.

    Raises:
        OSError: the file cannot be written.
    """
    palette = _palette(film)
    nearest = _nearest(palette)
    images = [_indexed(pixels, palette, nearest) for pixels in film.frames(advance)]
    durations_ms = [round(1e3 * _FRAME_S)] * (len(images) - 1) + [round(1e3 * _LAST_S)]
    content = BytesIO()
    images[0].save(
        *(content, 'GIF'),
        save_all=True,
        append_images=images[1:],
        duration=durations_ms,
        loop=0,
        optimize=True,
    )
    files.write_result(path, content.getbuffer())


def _palette(film: Film) -> Ints:
    """The colours that have a meaning, and those that most pixels have, (K, 3)."""
    shown = [film.picture.at(share * film.picture.end_s).copy() for share in _SAMPLED]
    mosaic = Image.fromarray(np.concatenate(shown)).convert('RGB')
    counted = mosaic.getcolors(mosaic.width * mosaic.height) or []
    most = [colour for _, colour in sorted(counted, reverse=True)]
    kept = dict.fromkeys([*map(ImageColor.getrgb, MEANT), *most])
    return np.array([*kept][:_N_COLOURS])


def _nearest(palette: Ints) -> NDArray[np.uint8]:
    """The place in the palette of each colour of 5 bits a part, (32768,)."""
    parts = np.stack(np.meshgrid(*3 * [np.arange(32)], indexing='ij'), axis=-1).reshape(-1, 3)
    colours = parts << 3 | parts >> 2  # of all 8 bits
    distance = (colours**2).sum(axis=1)[:, None] - 2 * colours @ palette.T
    nearest: Ints = (distance + (palette**2).sum(axis=1)).argmin(axis=1)
    return nearest.astype(np.uint8)


def _indexed(pixels: Pixels, palette: Ints, nearest: NDArray[np.uint8]) -> Image.Image:
    red, green, blue = (pixels[..., part].astype(np.uint16) >> 3 for part in range(3))
    image = Image.fromarray(nearest[red << 10 | green << 5 | blue])
    image.putpalette(palette.astype(np.uint8).tobytes())
    return image


def check_ffmpeg() -> str:
    """Where ffmpeg is.

    Raises:
        FilmError: it is not installed.
    """
    found = shutil.which(_FFMPEG)
    if found is None:
        raise FilmError(f'{_FFMPEG} is missing, which MP4 needs: {_REMEDY}')
    return found


def write_mp4(film: Film, path: Path, advance: Advance) -> None:
    """Write a film as MP4, by ffmpeg.

    Raises:
        FilmError: there is no ffmpeg, or it cannot do it.
        OSError: the file cannot be written.
    """
    with TemporaryDirectory() as folder, _encoder(film, Path(folder) / 'film.mp4') as (put, made):
        pixels: Pixels = None
        for pixels in film.frames(advance):
            put(pixels)
        for _ in range(round(_LAST_S / _FRAME_S)):
            put(pixels)
        files.write_result(path, made())


@contextmanager
def _encoder(
    film: Film, file: Path
) -> Iterator[tuple[Callable[[Pixels], None], Callable[[], bytes]]]:
    """An ffmpeg at work: what takes a frame, and what gives the film once all are in."""
    width, height = film.picture.size
    words = [
        *(check_ffmpeg(), '-loglevel', 'error', '-y', '-f', 'rawvideo', '-pix_fmt', 'rgba'),
        *('-s', f'{width}x{height}', '-r', f'{1 / _FRAME_S:g}', '-i', '-', '-an'),
        *('-pix_fmt', 'yuv420p', '-movflags', '+faststart', '-map_metadata', '-1', str(file)),
    ]
    popen = subprocess.Popen(
        words, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE
    )

    def put(pixels: Pixels) -> None:
        try:
            popen.stdin.write(np.ascontiguousarray(pixels).data)  # type: ignore[union-attr]
        except BrokenPipeError:
            made()

    def made() -> bytes:
        _, said = popen.communicate()
        if popen.returncode != 0:
            why = in_one_line(said.decode(errors='replace'))
            raise FilmError(f'{_FFMPEG} failed with exit status {popen.returncode}: {why}')
        return file.read_bytes()

    try:
        yield put, made
    finally:
        popen.kill()
        popen.communicate()
