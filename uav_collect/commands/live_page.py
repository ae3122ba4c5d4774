"""The page of a mission that flies, for as long as somebody looks at it."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
import os
from pathlib import Path
import re
import time
import webbrowser

from uav_collect.commands.ros_processes import FleetProcess, running_fleet
from uav_collect.commands.terminal import say
from uav_collect.errors import FleetError
from uav_collect.kernels.patience import waiting_for

_VIEWER = 'viewer'
_URL = re.compile(r'the page is at (http://\S+)')
_LOOK_S = 0.05
_SCREENS = ('DISPLAY', 'WAYLAND_DISPLAY')  # variables that say that there is one


@contextmanager
def live_page(
    folder: Path, n_processes: int, flags: Sequence[str]
) -> Iterator[Callable[[], None]]:
    """Serve the page of the missions that fly meanwhile, and open it where there is a screen.

    Args:
        folder: for what the viewer says.
        n_processes: that fly.
        flags: of the viewer.

    Yields:
        What keeps the page there until Ctrl-C.

    Raises:
        FleetError: the viewer does not start.
    """
    with running_fleet(folder, n_processes + 1) as viewers:
        viewer = viewers.start(_VIEWER, _VIEWER, flags)
        url = _url_of(viewer)
        say(f'watch it at {url}')
        if any(map(os.environ.get, _SCREENS)):
            webbrowser.open(url)
        yield lambda: _stay(viewer, url)


def _url_of(viewer: FleetProcess) -> str:
    with waiting_for('the page'):
        while True:
            has_ended = viewer.popen.poll() is not None
            found = _URL.search('\n'.join(viewer.log_lines()))
            if found:
                return found[1]
            if has_ended:
                raise FleetError(f'the viewer has ended{viewer.log_tail()}')
            time.sleep(_LOOK_S)


def _stay(viewer: FleetProcess, url: str) -> None:
    say(f'the page stays at {url} until Ctrl-C')
    try:
        while viewer.popen.poll() is None:
            time.sleep(_LOOK_S)
    except KeyboardInterrupt:
        return
    raise FleetError(f'the viewer has ended{viewer.log_tail()}')
