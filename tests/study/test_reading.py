"""How tractions are read from nodal forces: the weights of each element, and none."""

from mpi4py import MPI

import numpy as np
import pytest
import ufl
from dolfinx import fem
from dolfinx.mesh import CellType, create_box

from pw_elements import (
    Body,
    Material,
    Sibling,
    Spaces,
    SurfaceNodes,
    assemble_vector,
    boundary_measure,
    force_transfer,
)
from pw_elements.elasticity import StressState
from pw_elements.meshes import triangles
from study.model.reading import compared, transferred


def below(x):
    return np.isclose(x[-1], 0.0)


def plane(state):
    mesh = triangles(MPI.COMM_SELF, (0.0, 0.0), (2.0, 1.0), (5, 2))
    return Body(Spaces.galerkin(mesh), Material(1.0, 0.3), state), lambda x: np.isclose(x[1], 0.0)


def solid():
    mesh = create_box(MPI.COMM_SELF, [(0, 0, 0), (3, 2, 1)], [3, 2, 1], CellType.tetrahedron)
    return Body(Spaces.galerkin(mesh), Material(1.0, 0.3), StressState.SOLID), below


BODIES = {
    "plane": lambda: plane(StressState.PLANE_STRAIN),
    "axisymmetric": lambda: plane(StressState.AXISYMMETRIC),
    "solid": solid,
}


@pytest.mark.parametrize("kind", BODIES)
def test_even_pressure_is_read_with_each_elements_own_weights(kind):
    body, where = BODIES[kind]()
    space = body.spaces.trial
    up = np.eye(space.mesh.geometry.dim)[-1]
    standard = assemble_vector(
        body.surface_load(tuple(3 * up), boundary_measure(space.mesh, where))
    )
    of_sibling = Sibling.from_space(space).load(standard)
    for transfer, force in ((None, standard), (force_transfer(space), of_sibling)):
        surface = SurfaceNodes.from_body(body, where)
        if transfer is not None:
            surface = transferred(surface, transfer)
        nodal = force.array_r.reshape(-1, len(up))[surface.node, -1]
        read = surface.pressure(nodal)
        known = ~np.isnan(read)
        assert read[known] == pytest.approx(3.0)
        # a corner of the standard T10, and a standard node on the axis, have no weight
        lacking = {"plane": 0, "axisymmetric": 1, "solid": 4 * 3}[kind] if transfer is None else 0
        assert (~known).sum() == lacking
        assert nodal[~known] == pytest.approx(0.0, abs=1e-12)


def test_siblings_weights_are_integrals_of_its_basis():
    """Of T N, each interpolated as a function of its own and integrated over the face."""
    body, where = solid()
    space = body.spaces.trial
    surface = transferred(SurfaceNodes.from_body(body, where), force_transfer(space))
    basis, function = Sibling.from_space(space).basis, fem.Function(space)
    ds = boundary_measure(space.mesh, where)
    for place in (0, 1, len(surface.node) // 2):
        unit = basis.createVecRight()
        unit.array[3 * surface.node[place] + 2] = 1.0
        function.x.array[:] = (basis * unit).array_r
        found = fem.assemble_scalar(fem.form(ufl.as_vector(function)[2] * ds))
        assert surface.weight_area[place] == pytest.approx(found, rel=1e-12)


def test_errors_on_common_nodes_and_on_the_others():
    nan = np.nan
    error, other = np.array([1.0, -3.0, nan, 2.0, nan]), np.array([5.0, nan, 1.0, 0.0, nan])
    assert compared(error, other) == pytest.approx(
        {
            "common_median": 1.5,
            "common_rms": np.sqrt(2.5),
            "common_max": 2.0,
            "common_nodes": 2.0,
            "alone_median": 3.0,
            "alone_rms": 3.0,
            "alone_max": 3.0,
            "alone_nodes": 1.0,
        }
    )
    assert "alone_max" not in compared(other, np.zeros(5))
