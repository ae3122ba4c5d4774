"""What a picture shows, as Matplotlib has it."""

from matplotlib.axes import Axes


def legend_of(axes: Axes) -> list[str]:
    """The names in a legend, in its order."""
    legend = axes.get_legend()
    assert legend is not None
    return [text.get_text() for text in legend.get_texts()]
