"""Test pressures computed from nodal forces by each element's weights, some of which vanish."""

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
from study.model.reading import error_norms_on_common_and_other_nodes, multiply_nodal_weights_by_T


def on_lower_side(x):
    return np.isclose(x[-1], 0.0)


def make_plane_body_and_face_marker(state):
    mesh = triangles(MPI.COMM_SELF, (0.0, 0.0), (2.0, 1.0), (5, 2))
    return Body(Spaces.galerkin(mesh), Material(1.0, 0.3), state), lambda x: np.isclose(x[1], 0.0)


def make_solid_body_and_face_marker():
    mesh = create_box(MPI.COMM_SELF, [(0, 0, 0), (3, 2, 1)], [3, 2, 1], CellType.tetrahedron)
    return Body(Spaces.galerkin(mesh), Material(1.0, 0.3), StressState.SOLID), on_lower_side


BODY_MAKERS_BY_NAME = {
    "plane": lambda: make_plane_body_and_face_marker(StressState.PLANE_STRAIN),
    "axisymmetric": lambda: make_plane_body_and_face_marker(StressState.AXISYMMETRIC),
    "solid": make_solid_body_and_face_marker,
}


@pytest.mark.parametrize("body_name", BODY_MAKERS_BY_NAME)
def test_even_pressure_is_recovered_with_each_elements_own_weights(body_name):
    body, on_face = BODY_MAKERS_BY_NAME[body_name]()
    space = body.spaces.trial
    vertical = np.eye(space.mesh.geometry.dim)[-1]
    standard_load = assemble_vector(
        body.surface_load(tuple(3 * vertical), boundary_measure(space.mesh, on_face))
    )
    sibling_load = Sibling.from_space(space).load(standard_load)
    for transfer, force in ((None, standard_load), (force_transfer(space), sibling_load)):
        surface = SurfaceNodes.from_body(body, on_face)
        if transfer is not None:
            surface = multiply_nodal_weights_by_T(surface, transfer)
        nodal_force = force.array_r.reshape(-1, len(vertical))[surface.node, -1]
        pressure = surface.pressure(nodal_force)
        has_reading = ~np.isnan(pressure)
        assert pressure[has_reading] == pytest.approx(3.0)
        # the weights of corners of the standard T10 and of the standard node on the axis vanish
        n_without_reading = (
            {"plane": 0, "axisymmetric": 1, "solid": 4 * 3}[body_name] if transfer is None else 0
        )
        assert (~has_reading).sum() == n_without_reading
        assert nodal_force[~has_reading] == pytest.approx(0.0, abs=1e-12)


def test_siblings_weights_are_integrals_of_its_basis():
    """The sibling's weight of a node is the integral of the node's basis function over the face.

    The basis function is a row of T N, where N are the trial functions. The test interpolates it
    and integrates it numerically.
    """
    body, on_face = make_solid_body_and_face_marker()
    space = body.spaces.trial
    surface = multiply_nodal_weights_by_T(
        SurfaceNodes.from_body(body, on_face), force_transfer(space)
    )
    basis, basis_function = Sibling.from_space(space).basis, fem.Function(space)
    ds = boundary_measure(space.mesh, on_face)
    for row in (0, 1, len(surface.node) // 2):
        unit_vector = basis.createVecRight()
        unit_vector.array[3 * surface.node[row] + 2] = 1.0
        basis_function.x.array[:] = (basis * unit_vector).array_r
        integral = fem.assemble_scalar(fem.form(ufl.as_vector(basis_function)[2] * ds))
        assert surface.weight_area[row] == pytest.approx(integral, rel=1e-12)


def test_error_norms_are_split_into_common_and_other_nodes():
    nan = np.nan
    error, other_error = np.array([1.0, -3.0, nan, 2.0, nan]), np.array([5.0, nan, 1.0, 0.0, nan])
    assert error_norms_on_common_and_other_nodes(error, other_error) == pytest.approx(
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
    assert "alone_max" not in error_norms_on_common_and_other_nodes(other_error, np.zeros(5))
