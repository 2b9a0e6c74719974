"""The oracle's own law against plain arithmetic."""

import numpy as np
import pytest

from tests.oracle.contact import law_error


@pytest.mark.parametrize(
    ("force", "motion"),
    [
        ((-1e-3, 0.0), (0.0, 0.0)),  # pulls
        ((1.0, 0.0), (-1e-3, 0.0)),  # has gone through
        ((1.0, 0.0), (1e-3, 0.0)),  # pushes from afar
        ((1.0, 0.301), (0.0, 0.0)),  # out of the cone
        ((1.0, 0.1), (0.0, -1e-3)),  # slips inside of it
        ((1.0, 0.3), (0.0, 1e-3)),  # slips along the friction
    ],
)
def test_every_line_of_the_law_is_looked_at(force, motion):
    good, none = np.array([[1.0, 0.3], [1.0, 0.1]]), np.array([[0.0, -0.5], [0.0, 0.0]])
    mu = np.full(3, 0.3)
    assert law_error(good, none, mu[:2]) < 1e-15
    assert law_error(np.vstack([good, force]), np.vstack([none, motion]), mu) > 1e-4
