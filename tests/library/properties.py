"""Helpers for tests of elements: small problems, dense matrices and bounds of round-off."""

import functools
from dataclasses import dataclass, field

from mpi4py import MPI

import numpy as np
import scipy.linalg
from dolfinx import fem
from dolfinx.mesh import create_box, create_rectangle, exterior_facet_indices

from pw_elements import (
    Body,
    Material,
    Reduction,
    Spaces,
    assemble_matrix,
    assemble_vector,
    prescribe,
    reactions,
    solve,
)
from pw_elements.meshes import move_nodes
from study.meshes.distortion import distort_unit_domain_smoothly
from study.model.matrices import to_dense_array
from tests.library.random_meshes import AffinePlacement, Grid

SPACE_MAKERS_BY_METHOD = {"galerkin": Spaces.galerkin, "pw": Spaces.petrov_galerkin}


def make_distorted_unit_mesh(cell_type, cells_per_side):
    """Create a unit square or cube with the given cells per side, and distort it smoothly."""
    dim = 2 if cell_type.name in ("triangle", "quadrilateral") else 3
    build, corners = (create_rectangle if dim == 2 else create_box), [(0.0,) * dim, (1.0,) * dim]
    return move_nodes(
        build(MPI.COMM_SELF, corners, [cells_per_side] * dim, cell_type),
        distort_unit_domain_smoothly,
    )


def boundary_dofs(space):
    """Return the unknowns of a space that lie on the boundary."""
    topology = space.mesh.topology
    topology.create_connectivity(topology.dim - 1, topology.dim)
    return fem.locate_dofs_topological(space, topology.dim - 1, exterior_facet_indices(topology))


def dense_solution(K, f, conditions):
    """Solve K x = f with NumPy, after replacing the rows of prescribed unknowns."""
    A, b = to_dense_array(K), f.array.copy()
    for condition in conditions:
        dofs, _ = condition.dof_indices()
        values = np.zeros(len(b))
        condition.set(values)
        A[dofs], b[dofs] = 0, values[dofs]
        A[dofs, dofs] = 1
    return np.linalg.solve(A, b)


def assert_small(error, bound):
    """Assert that no error exceeds the bound and that none is NaN."""
    largest = np.abs(error).max(initial=0.0)
    assert largest <= bound, f"{largest:.3g} exceeds {bound:.3g}"


def max_nonzeros_per_row(A):
    """Return the largest number of non-zero entries in a row of A, used in bounds of round-off."""
    return np.count_nonzero(A, axis=1).max()


def rigid_modes(node_positions):
    """Return the rigid modes (n, dim, modes) at the given nodes (n, dim).

    They are translations, followed by rotations about the mean position.
    """
    n, dim = node_positions.shape
    s = node_positions - node_positions.mean(axis=0)
    s = s / np.abs(s).max()
    planes = [(i, j) for i in range(dim) for j in range(i)]
    modes = np.zeros((n, dim, dim + len(planes)))
    modes[:, :, :dim] = np.eye(dim)
    for k, (i, j) in enumerate(planes):
        modes[:, i, dim + k], modes[:, j, dim + k] = -s[:, j], s[:, i]
    return modes


@dataclass(frozen=True)
class PlacedElasticBody:
    """Elastic body on a grid in a given placement, with its stiffness, mass and nodes."""

    grid: Grid
    placement: AffinePlacement = field(default_factory=AffinePlacement)
    method: str = "pw"
    state: str = "plane stress"
    material: Material = field(default_factory=lambda: Material(1.0, 0.3))

    def make_transformed_copy(self, placement, modulus=1.0, density=1.0, grid=None):
        material = Material(modulus, self.material.poissons_ratio, density)
        return PlacedElasticBody(grid or self.grid, placement, self.method, self.state, material)

    @functools.cached_property
    def placed_grid(self):
        return self.grid.map_vertices(self.placement.place_points)

    @functools.cached_property
    def body(self):
        return Body(
            SPACE_MAKERS_BY_METHOD[self.method](self.placed_grid.mesh()), self.material, self.state
        )

    @functools.cached_property
    def space(self):
        return self.body.spaces.trial

    @functools.cached_property
    def K(self):
        return assemble_matrix(self.body.stiffness())

    @functools.cached_property
    def M(self):
        return assemble_matrix(self.body.mass())

    @functools.cached_property
    def x(self):
        return self.space.tabulate_dof_coordinates()[:, : self.grid.dim]

    @functools.cached_property
    def relative_gradient_round_off(self):
        return self.placed_grid.relative_gradient_round_off()

    def side_marker(self, axis, coordinate=0.0):
        return self.placement.side_marker(axis, coordinate)

    def clamped_side_reduction(self, axis=0):
        conditions = [
            prescribe(self.space, i, self.side_marker(axis)) for i in range(self.grid.dim)
        ]
        return Reduction.dirichlet(self.space, conditions)

    def solve_statics(self, body_force):
        """Return displacements, reactions and loads, each (n, dim), under a body force."""
        f = assemble_vector(self.body.body_load(body_force))
        a = solve(self.K, f, self.clamped_side_reduction())
        vectors = (a, reactions(self.K, a, f), f)
        return tuple(v.array.reshape(-1, self.grid.dim) for v in vectors)

    def bound_round_off_of_forces(self, displacements):
        """Return a bound of the round-off in nodal forces K a and in a direct solver's residual."""
        K = np.abs(to_dense_array(self.K))
        return len(K) * self.relative_gradient_round_off * (K @ np.abs(displacements.ravel())).max()

    def bound_errors_of_displacements_and_forces(self, reduction, a, f, relative_round_off=None):
        """Return bounds of the errors of displacements and forces due to round-off of the data.

        If entries of K and f have a relative error d, the error of the solution a is at most
        |K^-1| (d |K||a| + d |f|), component by component (R. D. Skeel 1979). The error of the
        forces is at most |K| times this bound plus d |K||a| + d |f|.
        """
        A, full = to_dense_array(reduction.matrix(self.K)), np.abs(to_dense_array(self.K))
        d = max_nonzeros_per_row(full) * (
            self.relative_gradient_round_off if relative_round_off is None else relative_round_off
        )
        wrong = d * (full @ np.abs(a.ravel()) + np.abs(f.ravel()))
        free = to_dense_array(reduction.right).T @ wrong
        displacement_bound = np.abs(np.linalg.inv(A)) @ free
        return displacement_bound.max(), (
            full @ to_dense_array(reduction.right) @ displacement_bound + wrong
        ).max()


def eigenvalue_and_error_bound(A, B, select_index, error_norm_A, error_norm_B):
    """Return an eigenvalue of A x = mu B x, and a bound of its error.

    `select_index` returns the index of the eigenvalue in the array of all eigenvalues. The errors
    dA and dB of the matrices have the norms `error_norm_A` and `error_norm_B`. To first order, the
    error is at most |y| (|dA| + |mu||dB|) |x| / |y B x|, with the left and right eigenvectors y and
    x.
    """
    mu, left, right = scipy.linalg.eig(A, B, left=True)
    k = select_index(mu)
    y, x = left[:, k], right[:, k]
    size = np.linalg.norm(y) * np.linalg.norm(x) / abs(y.conj() @ B @ x)
    return mu[k], size * (error_norm_A + abs(mu[k]) * error_norm_B)
