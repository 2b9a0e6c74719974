"""Style of the study, for import by figure scripts.

Importing this module also imports the package `figures`, which allows scripts to be run directly.
"""

from study.publish.plots.style import (
    COLUMN_WIDTH,
    ELEMENT_LOOK,
    LABEL_BOX,
    MAX_VECTOR_ITEMS,
    METHOD_LOOK,
    PAGE_WIDTH,
    PAIR_NARROW_WIDTH,
    PAIR_WIDE_WIDTH,
    draw_quadratic_mesh_with_nodes,
    label_log_y_axis_with_plain_numbers,
    study_style,
)

__all__ = [
    "COLUMN_WIDTH",
    "ELEMENT_LOOK",
    "LABEL_BOX",
    "MAX_VECTOR_ITEMS",
    "METHOD_LOOK",
    "PAGE_WIDTH",
    "PAIR_NARROW_WIDTH",
    "PAIR_WIDE_WIDTH",
    "draw_quadratic_mesh_with_nodes",
    "label_log_y_axis_with_plain_numbers",
    "study_style",
]
