"""Section 7.5: a column of changing cross-section between rigid surfaces (Figs 15 to 23, Table 1).

Printed: E = 2.1e8, Poisson's ratio 0.3, friction 0.3, density 7856, a descent of 1 mm, 759 8-node
elements, and Table 1. The section is lost; the study's own stands in for it, here in a coarse mesh.
"""

from unittest.mock import patch

import numpy as np
import pytest

from study.paper import s7_5_column, s7_5_profiles
from study.paper.items import TABLE_1
from tests.oracle.contact import Pair, solve
from tests.oracle.eigen import smallest
from tests.oracle.problem import (
    NORMAL_DOWN,
    NORMAL_UP,
    STATIC,
    Problem,
    assert_agrees,
    assert_differs,
    both,
    on,
    oracle_body,
    plane,
    sorted_nodes,
    without_inner_nodes,
)
from tests.oracle.sections import converged, points
from tests.paper.statements import judged, printed

test_statement = judged("7.5")

PRINTED = """
CAX6                  36389.  1.9319E+06  3.8114E+06  3.9787E+06  5.7680E+06  7.6025E+06
6-node user element   36386.  1.9317E+06  3.8104E+06  3.9763E+06  5.7636E+06  7.5964E+06
CAX8                  36386.  1.9320E+06  3.8113E+06  3.9784E+06  5.7679E+06  7.6010E+06
8-node user element   36390.  1.9310E+06  3.8080E+06  3.9723E+06  5.7537E+06  7.5789E+06
"""

# The first of the study's columns, its radii and heights from the base, in a coarser mesh
RADII, HEIGHTS = (0.04787, 0.11121, 0.14669, 0.04126), (0.23155, 0.14025, 0.18777, 0.03384)
COARSE = s7_5_profiles.Profile(RADII, HEIGHTS, (2, 1, 2, 1), (6, 4, 5, 2))


def stepped_column(element):
    """Pressed down by 1 mm on its three supports; its vibration when it stands on its base."""
    with patch.dict(s7_5_column.PROFILES, coarse=COARSE), converged(element):
        result = s7_5_column.stepped_column(element, section="coarse")
    level = np.concatenate([[0.0], np.cumsum(HEIGHTS)])
    faces = [
        (0.0, RADII[0], level[0], NORMAL_UP, 0.0),
        (RADII[0], RADII[1], level[1], NORMAL_UP, 1e-4),
        (RADII[1], RADII[2], level[2], NORMAL_UP, 2e-4),
        (0.0, RADII[3], level[4], NORMAL_DOWN, 0.0),
    ]
    count = points(element)

    def ours(linear):
        body = oracle_body(
            result, element, linear, "axisymmetric", 2.1e8, 0.3, rho=7856.0, count=count
        )
        K, on_axis = body.stiffness(), body.at_nodes(on(0, 0.0), (0,))
        descent = [((0.0, -1e-4 * k), (0.0, 0.0)) for k in range(1, 11)]
        pairs = []
        for inner, outer, z, normal, gap in faces:
            between = both(
                on(1, z), lambda x, a=inner, b=outer: (x[:, 0] > a - 1e-9) & (x[:, 0] < b + 1e-9)
            )
            motions = descent if normal is NORMAL_DOWN else ()
            nodes = sorted_nodes(result.curves, between)
            pairs.append(Pair(nodes, *plane(normal, z - gap), 0.3, motions))
        loads = [np.zeros(body.nodes.size)] * 10
        state = solve(K, loads, on_axis, pairs, body.nodes)[-1]
        found = {"displacement": state.displacement}
        for k, (face, force) in enumerate(zip(faces, state.forces, strict=True), 1):
            found[f"force_n_{k}"], found[f"force_t_{k}"] = force @ face[3], -force[:, 0]
            found[f"force_normal_{k}"] = found[f"force_n_{k}"].sum()
        standing = on_axis | body.at_nodes(on(1, 0.0), (1,))
        K, M, standing = without_inner_nodes(body, element, standing)
        found["omega2"] = smallest(K, M, standing, 6).real
        return found

    scalars, curves = result.scalars, result.curves
    theirs = {"omega2": np.array([scalars[f"omega2_{i}"] for i in range(1, 7)])}
    theirs["displacement"] = curves["displacement"]
    for k in range(1, 5):
        theirs |= {f"force_{c}_{k}": curves[f"force_{c}_{k}"] for c in "nt"}
        theirs[f"force_normal_{k}"] = scalars[f"force_normal_{k}"]
    scales = {f"force_t_{k}": theirs[f"force_n_{k}"].max() for k in range(1, 5)}
    return Problem(theirs, ours, scales)


@pytest.mark.parametrize("element", STATIC)
def test_oracle_finds_the_numbers_of_the_study(element):
    assert_agrees(stepped_column(element), element)


def test_with_the_other_weights_it_does_not():
    """Else the test above could not tell whether the weights are the piecewise-linear ones."""
    assert_differs(stepped_column("pw-T6"))


def test_table_1_is_the_printed_one():
    rows = [line.rsplit(maxsplit=6) for line in PRINTED.strip().splitlines()]
    assert {name: tuple(map(float, numbers)) for name, *numbers in rows} == TABLE_1


def test_printed_numbers(results):
    study = s7_5_column
    assert (study.YOUNGS_MODULUS, study.POISSONS_RATIO, study.DENSITY) == (2.1e8, 0.3, 7856.0)
    assert (study.FRICTION, study.DESCENT) == (0.3, 1e-3)
    assert (printed("75-mesh"), printed("75-three-tenths")) == (759.0, 0.3)
    assert len(results.curves("7.5/galerkin-Q8")["cells"]) == 759


def test_largest_difference_between_the_printed_rows():
    """Less than 0.3 % within a family of elements, but not across: 8-node against CAX6."""
    rows = {name: np.array(row) for name, row in TABLE_1.items()}

    def difference(element, standard):
        return 100 * np.abs(rows[element] / rows[standard] - 1).max()

    assert difference("6-node user element", "CAX6") == pytest.approx(0.0802, abs=1e-4)
    assert difference("8-node user element", "CAX8") == pytest.approx(0.2907, abs=1e-4)
    assert difference("8-node user element", "CAX6") == pytest.approx(0.3104, abs=1e-4)
