"""The parts of Matplotlib that pictures are drawn with: figures alone, which need no screen.

The environment may name a backend that is not installed here, as terminals in notebooks do; then
Matplotlib does not even load, although pictures have no use for any.
"""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
import logging
import os
import sys

_BACKEND = 'MPLBACKEND'


@contextmanager
def _no_backend() -> Iterator[None]:
    """Load Matplotlib as if no backend were named, and say nothing of folders that it lacks."""
    named = os.environ.pop(_BACKEND, None)
    is_new, logger = 'matplotlib' not in sys.modules, logging.getLogger('matplotlib')
    level = logger.level
    logger.setLevel(logging.ERROR)
    try:
        yield
    finally:
        logger.setLevel(level)
        if named is not None:
            os.environ[_BACKEND] = named
    if is_new and named is not None:
        with suppress(ValueError):  # others in this process may count on it, if it is one
            matplotlib.rcParams['backend'] = named


with _no_backend():
    import matplotlib
    from matplotlib.axes import Axes
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.image import imread
    from matplotlib.lines import Line2D
    from matplotlib.markers import MarkerStyle
    from matplotlib.patches import Rectangle
    from matplotlib.patheffects import Normal, withStroke
    from matplotlib.ticker import EngFormatter
    from matplotlib.transforms import Affine2D

__all__ = [
    'Affine2D',
    'Axes',
    'EngFormatter',
    'Figure',
    'FigureCanvasAgg',
    'Line2D',
    'MarkerStyle',
    'Normal',
    'Rectangle',
    'imread',
    'withStroke',
]
