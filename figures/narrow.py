"""A figure of the page's width laid out again for a telephone: panels below each other."""

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.gridspec import GridSpec
from matplotlib.legend import Legend

WIDTH = 3.7
"""In inches: what a screen of 390 pixels shows without shrinking."""
TALL = 0.8  # of the width: the most that a panel of curves gets
CROWD = 4  # from so many panels in a row on, two stay side by side
ENTRIES = 2  # columns of a legend below the panels


def narrowed(figure: Figure) -> Figure:
    """Lay a figure out again, no wider than `WIDTH`; return it.

    Rows of panels become columns. What shared the labels of its neighbour gets its own.
    """
    width, height = figure.get_size_inches()
    if width <= WIDTH:
        return figure
    panels = [ax for ax in figure.axes if ax.get_subplotspec() is not None]
    grids = {ax.get_subplotspec().get_topmost_subplotspec().get_gridspec() for ax in panels}
    grid = grids.pop() if len(grids) == 1 else None
    if grid is None or grid.ncols == 1 or len(panels) != grid.nrows * grid.ncols:
        figure.set_size_inches(WIDTH, max(height * WIDTH / width, min(height, 0.8 * WIDTH)))
    else:
        columns = 2 if grid.ncols >= CROWD or _pictures(panels) else 1
        rows = -(-len(panels) // columns)
        per_row = height / grid.nrows * (WIDTH / columns) / (width / grid.ncols)
        least = 0.0 if _pictures(panels) else 0.6 * WIDTH / columns
        _own_labels(panels, grid)
        heights = [h for h in grid.get_height_ratios() for _ in range(grid.ncols)][::columns]
        if columns > 1:
            heights = [1.0] * rows
        places = GridSpec(rows, columns, figure, height_ratios=heights)
        for ax, place in zip(panels, places, strict=False):
            ax.set_subplotspec(place)
        figure.set_size_inches(WIDTH, rows * max(min(per_row, TALL * WIDTH), least))
    for legend in list(figure.legends):
        _narrow_legend(figure, legend)
    return figure


def _pictures(panels: list[Axes]) -> bool:
    """Whether panels show bodies, to scale, and no curves."""
    return all(ax.get_aspect() not in ("auto",) for ax in panels) and len(panels) > CROWD


def _own_labels(panels: list[Axes], grid: GridSpec) -> None:
    """Give each panel the labels of the row and the column that it leaves."""
    by_place = {
        (ax.get_subplotspec().rowspan.start, ax.get_subplotspec().colspan.start): ax
        for ax in panels
    }
    for (row, column), ax in by_place.items():
        left, bottom = by_place[row, 0], by_place[grid.nrows - 1, column]
        if not ax.axison:
            continue
        if ax.get_shared_y_axes().joined(ax, left) or not ax.get_ylabel():
            ax.set_ylabel(ax.get_ylabel() or left.get_ylabel())
        if not ax.get_xlabel():
            ax.set_xlabel(bottom.get_xlabel())
        ax.tick_params(labelleft=True, labelbottom=True)


def _narrow_legend(figure: Figure, legend: Legend) -> None:
    handles, labels = legend.legend_handles, [text.get_text() for text in legend.get_texts()]
    size = legend.get_texts()[0].get_fontsize()
    upper = getattr(legend, "_outside_loc", None) == "upper"
    legend.remove()
    place = f"outside {'upper' if upper else 'lower'} center"
    figure.legend(handles, labels, loc=place, ncols=ENTRIES, fontsize=min(size, 7.5))
