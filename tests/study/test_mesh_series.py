"""The series of meshes of the uncertainty: known cases that differ by the mesh alone."""

from itertools import pairwise

import pytest

from study.judge.grid_convergence import MIN_REFINEMENT_RATIO
from study.judge.mesh_series import QUANTITIES
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


def test_each_quantity_has_the_new_and_the_standard_triangle_and_a_name_of_its_own():
    for quantity in QUANTITIES:
        new, standard = (
            CASES[keys[0]].stored_parameters["element"]
            for keys in (quantity.new, quantity.standard)
        )
        assert (new.startswith("pw"), standard) == (True, "galerkin-T6")
    names = [(quantity.section, quantity.words) for quantity in QUANTITIES]
    assert len(set(names)) == len(names)
