"""Rearrange figures for the screens of telephones, with panels below each other."""

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.gridspec import GridSpec, SubplotSpec
from matplotlib.legend import Legend

SCREEN_WIDTH = 3.7
"""Largest width in inches of a figure that a screen of 390 pixels shows without scaling."""
MIN_HEIGHT_RATIO, MAX_HEIGHT_RATIO = (
    0.6,
    0.8,
)  # range of the ratio of height to width for panels that show curves
MIN_PANELS_FOR_TWO_COLUMNS = 4  # rows with at least this many panels become two columns
MAX_LEGEND_COLUMNS = 2  # maximum number of columns of a legend, if they fit


def rearrange_figure_for_telephone(figure: Figure) -> Figure:
    """Rearrange a figure in place, such that it is no wider than `SCREEN_WIDTH`, and return it.

    Panels of a row are placed below each other, or in two columns if there are many. Panels that
    shared labels with an adjacent panel get their own.
    """
    width, height = figure.get_size_inches()
    if width <= SCREEN_WIDTH:
        return figure
    specs_by_panel = {ax: spec for ax in figure.axes if (spec := ax.get_subplotspec())}
    grids = {spec.get_topmost_subplotspec().get_gridspec() for spec in specs_by_panel.values()}
    grid = grids.pop() if len(grids) == 1 else None
    if grid is not None and grid.ncols == 1 < grid.nrows == len(specs_by_panel):
        figure.set_size_inches(SCREEN_WIDTH, height)
    elif grid is None or grid.ncols == 1 or len(specs_by_panel) != grid.nrows * grid.ncols:
        figure.set_size_inches(
            SCREEN_WIDTH,
            max(height * SCREEN_WIDTH / width, min(height, MAX_HEIGHT_RATIO * SCREEN_WIDTH)),
        )
    else:
        _copy_shared_labels_to_all_panels(specs_by_panel, grid.nrows)
        are_pictures = len(specs_by_panel) > MIN_PANELS_FOR_TWO_COLUMNS and all(
            ax.get_aspect() != "auto" for ax in specs_by_panel
        )
        columns = 2 if are_pictures or grid.ncols >= MIN_PANELS_FOR_TWO_COLUMNS else 1
        rows = -(-len(specs_by_panel) // columns)
        ratios = np.repeat(grid.get_height_ratios(), grid.ncols)[::columns]
        new_grid = GridSpec(rows, columns, figure, height_ratios=None if columns > 1 else ratios)
        for number, ax in enumerate(specs_by_panel):
            ax.set_subplotspec(new_grid[divmod(number, columns)])
        panel_width = SCREEN_WIDTH / columns
        panel_height = height / grid.nrows * panel_width / (width / grid.ncols)
        min_panel_height = 0.0 if are_pictures else MIN_HEIGHT_RATIO * panel_width
        figure.set_size_inches(
            SCREEN_WIDTH,
            rows * max(min(panel_height, MAX_HEIGHT_RATIO * SCREEN_WIDTH), min_panel_height),
        )
    for legend in list(figure.legends):
        _reduce_legend_columns_to_fit(figure, legend)
    return figure


def _copy_shared_labels_to_all_panels(specs_by_panel: dict[Axes, SubplotSpec], rows: int) -> None:
    """Give each panel of a grid its own axis labels and title, copied from the panel that has them.

    Args:
        specs_by_panel: Position of each panel in the grid.
        rows: Number of rows of the grid.
    """
    panels_by_position = {
        (spec.rowspan.start, spec.colspan.start): ax for ax, spec in specs_by_panel.items()
    }
    for (row, column), ax in sorted(panels_by_position.items(), key=lambda item: item[0]):
        top, bottom = panels_by_position[0, column], panels_by_position[rows - 1, column]
        if column and not ax.get_ylabel():  # the panel to the left is already labelled
            ax.set_ylabel(panels_by_position[row, column - 1].get_ylabel())
        if not (ax.get_title() or ax.get_title(loc="left")):
            ax.set_title(top.get_title(), fontsize=top.title.get_fontsize())
        ax.set_xlabel(ax.get_xlabel() or bottom.get_xlabel())
        ax.tick_params(labelleft=True, labelbottom=True)


def _reduce_legend_columns_to_fit(figure: Figure, legend: Legend) -> None:
    handles: list[Artist] = [handle for handle in legend.legend_handles if handle]
    labels = [text.get_text() for text in legend.get_texts()]
    vertical_side = "upper" if getattr(legend, "_outside_loc", None) == "upper" else "lower"
    for columns in (MAX_LEGEND_COLUMNS, 1):
        legend.remove()
        location = f"outside {vertical_side} center"
        legend = figure.legend(handles, labels, loc=location, ncols=columns, fontsize=7.5)
        if legend.get_window_extent().width <= figure.bbox.width:
            break
