"""A figure of the page's width laid out again for a telephone: panels below each other."""

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.gridspec import GridSpec, SubplotSpec
from matplotlib.legend import Legend

WIDTH = 3.7
"""In inches: what a screen of 390 pixels shows without shrinking."""
LOW, TALL = 0.6, 0.8  # of a panel's width: what its height lies between if it shows curves
CROWD = 4  # from so many panels in a row on, two stay side by side
ENTRIES = 2  # columns of a legend below the panels, if they fit


def narrowed(figure: Figure) -> Figure:
    """Lay a figure out again, no wider than `WIDTH`; return it.

    Rows of panels become columns. What shared the labels of its neighbour gets its own.
    """
    width, height = figure.get_size_inches()
    if width <= WIDTH:
        return figure
    panels = {ax: spec for ax in figure.axes if (spec := ax.get_subplotspec())}
    grids = {spec.get_topmost_subplotspec().get_gridspec() for spec in panels.values()}
    grid = grids.pop() if len(grids) == 1 else None
    if grid is not None and grid.ncols == 1 < grid.nrows == len(panels):
        figure.set_size_inches(WIDTH, height)
    elif grid is None or grid.ncols == 1 or len(panels) != grid.nrows * grid.ncols:
        figure.set_size_inches(WIDTH, max(height * WIDTH / width, min(height, TALL * WIDTH)))
    else:
        _own_labels(panels, grid.nrows)
        pictures = len(panels) > CROWD and all(ax.get_aspect() != "auto" for ax in panels)
        columns = 2 if pictures or grid.ncols >= CROWD else 1
        rows = -(-len(panels) // columns)
        ratios = np.repeat(grid.get_height_ratios(), grid.ncols)[::columns]
        places = GridSpec(rows, columns, figure, height_ratios=None if columns > 1 else ratios)
        for number, ax in enumerate(panels):
            ax.set_subplotspec(places[divmod(number, columns)])
        across = WIDTH / columns
        tall = height / grid.nrows * across / (width / grid.ncols)
        least = 0.0 if pictures else LOW * across
        figure.set_size_inches(WIDTH, rows * max(min(tall, TALL * WIDTH), least))
    for legend in list(figure.legends):
        _narrow_legend(figure, legend)
    return figure


def _own_labels(panels: dict[Axes, SubplotSpec], rows: int) -> None:
    """Give each panel the labels of the row and the column that it leaves, and the title."""
    by_place = {(spec.rowspan.start, spec.colspan.start): ax for ax, spec in panels.items()}
    for (row, column), ax in sorted(by_place.items(), key=lambda item: item[0]):
        top, bottom = by_place[0, column], by_place[rows - 1, column]
        if column and not ax.get_ylabel():  # the nearest to the left has its own by now
            ax.set_ylabel(by_place[row, column - 1].get_ylabel())
        if not (ax.get_title() or ax.get_title(loc="left")):
            ax.set_title(top.get_title(), fontsize=top.title.get_fontsize())
        ax.set_xlabel(ax.get_xlabel() or bottom.get_xlabel())
        ax.tick_params(labelleft=True, labelbottom=True)


def _narrow_legend(figure: Figure, legend: Legend) -> None:
    handles: list[Artist] = [handle for handle in legend.legend_handles if handle]
    labels = [text.get_text() for text in legend.get_texts()]
    place = "upper" if getattr(legend, "_outside_loc", None) == "upper" else "lower"
    for columns in (ENTRIES, 1):
        legend.remove()
        where = f"outside {place} center"
        legend = figure.legend(handles, labels, loc=where, ncols=columns, fontsize=7.5)
        if legend.get_window_extent().width <= figure.bbox.width:
            break
