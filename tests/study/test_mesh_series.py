"""The series of meshes of the uncertainty: known cases that differ by the mesh alone."""

from itertools import pairwise

import numpy as np
import pytest

from study.judge.grid_convergence import MIN_REFINEMENT_RATIO
from study.judge.mesh_series import QUANTITIES
from study.paper.s7_4_rigid_plate import (
    BODY_DEPTH,
    ELEMENTS_UNDER_HALF_PLATE,
    HALF_BODY_WIDTH,
    HALF_PLATE_WIDTH,
    PATTERN,
    _mesh_body,
)
from study.run.cases import load_section

MESH_PARAMETERS = ("divisions", "refined")
CASES = {
    case.key: case
    for section in sorted({quantity.section for quantity in QUANTITIES})
    for case in load_section(section).cases
}
SERIES = sorted(
    {
        (keys, quantity.refinements)
        for quantity in QUANTITIES
        for keys in (quantity.new, quantity.standard)
    }
)
RECORD_PARAMETERS = ("measured", "units", "dofs")


def read_parameters(key):
    """Return the parameters that state the mesh, and all others, of a case."""
    parameters = {
        name: value
        for name, value in CASES[key].stored_parameters.items()
        if name not in RECORD_PARAMETERS
    }
    mesh = {name: parameters.pop(name) for name in MESH_PARAMETERS if name in parameters}
    if CASES[key].section == "7.4":  # alternates: see the test of the plate's edges
        del parameters["pattern"]
    return mesh, parameters


@pytest.mark.parametrize(("keys", "refinements"), SERIES, ids=lambda value: str(value[0]))
def test_cases_of_a_series_differ_by_the_mesh_alone(keys, refinements):
    meshes, others = zip(*map(read_parameters, keys), strict=True)
    assert others[0] == others[1] == others[2]
    assert len(meshes[0]) == 1
    ((name, coarse),) = meshes[0].items()
    for mesh, refinement in zip(meshes, refinements, strict=True):
        if name == "divisions":
            assert mesh[name] == [n * refinement for n in coarse]
        else:
            assert mesh[name] == coarse * refinement
    ratios = [fine / coarse for coarse, fine in pairwise(refinements)]
    assert min(ratios) >= MIN_REFINEMENT_RATIO


@pytest.mark.parametrize("suffix", ["", "-mu0", "-strain"])
def test_halving_leaves_the_diagonals_at_the_edges_of_the_plate_as_they_are(suffix):
    counts = [
        count_triangles_at_edges(CASES[f"7.4/pw-T6{suffix}{refinement}"].parameters)
        for refinement in ("", "-refined2", "-refined4")
    ]
    assert counts[0] == counts[1] == counts[2]
    turned = CASES["7.4/pw-T6-mu0-refined2-turned"].parameters
    assert count_triangles_at_edges(turned) != counts[0]


def count_triangles_at_edges(parameters):
    """Return how many triangles meet at the left and at the right edge of the plate."""
    pattern, refined = parameters.get("pattern", PATTERN), parameters.get("refined", 1)
    mesh = _mesh_body(
        ELEMENTS_UNDER_HALF_PLATE, HALF_BODY_WIDTH, BODY_DEPTH, pattern, refined, "triangle"
    )
    nodes, x = mesh.geometry.dofmap, mesh.geometry.x
    is_edge = [
        np.isclose(x[:, 0], side) & np.isclose(x[:, 1], 0)
        for side in (-HALF_PLATE_WIDTH, HALF_PLATE_WIDTH)
    ]
    return [int(mask[nodes].any(axis=1).sum()) for mask in is_edge]


def test_each_quantity_has_the_new_and_the_standard_triangle_and_a_name_of_its_own():
    for quantity in QUANTITIES:
        new, standard = (
            CASES[keys[0]].stored_parameters["element"]
            for keys in (quantity.new, quantity.standard)
        )
        assert (new.startswith("pw"), standard) == (True, "galerkin-T6")
    names = [(quantity.section, quantity.words) for quantity in QUANTITIES]
    assert len(set(names)) == len(names)
