"""Rectangles: bad input is named, and lines are where they were asked for."""

from mpi4py import MPI

import numpy as np
import pytest

from pw_elements.meshes import on_lines, quadrilaterals, triangles

COMM = MPI.COMM_SELF
LINES = np.array([0.0, 0.1, 0.5, 2.0])


@pytest.mark.parametrize("cell", ["triangle", "quadrilateral"])
def test_lines_are_where_they_were_asked_for(cell):
    x = on_lines(COMM, LINES, LINES - 2.0, cell).geometry.x
    assert np.unique(x[:, 0].round(12)) == pytest.approx(LINES)
    assert np.unique(x[:, 1].round(12)) == pytest.approx(LINES - 2.0)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: triangles(COMM, (0, 0), (0, 1), (2, 2)), r"from \(0, 0\) to \(0, 1\) has no area"),
        (lambda: quadrilaterals(COMM, (0, 0), (1, 1), (2, 0)), r"divisions \(2, 0\): at least one"),
        (lambda: triangles(COMM, (0, 0), (1, 1), (2, 2), "cross"), "pattern 'cross': the patterns"),
        (lambda: on_lines(COMM, LINES[::-1], LINES, "triangle"), "have to increase"),
        (lambda: on_lines(COMM, LINES[:1], LINES, "triangle"), "has no area"),
    ],
)
def test_mistakes_are_named(make, message):
    with pytest.raises(ValueError, match=message):
        make()
