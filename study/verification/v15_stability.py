"""Stability of the hybrid elements: the inf-sup constant of the whole operator, over meshes.

And, in the plane, what makes one of the other: K = T K_standard, T sharing out the equations of
equilibrium and leaving those of volume.

Each pair of spaces may be stable for itself, trial and weights, and the two together not be. What
counts is the least of sup over (w, q) of b((u, p), (w, q)) / |(w, q)| over all (u, p) of norm one,

    b = int 2 mu eps(u) : eps(w) - p div w - q div u,
    |(u, p)|^2 = int 2 mu eps(u) : eps(u) + p^2 / (2 mu),

at nu = 1/2, which is the smallest singular value of the matrix between the two norms.
"""

from collections.abc import Callable

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem
from scipy.sparse.linalg import LinearOperator, eigs

from pw_elements import Body, Material, Reduction, assemble_matrix, force_transfer, prescribe
from pw_elements.algebra import factorise
from pw_elements.elasticity import StressState
from pw_elements.meshes import move_nodes, triangles
from pw_elements.spaces import SubSpace
from study.meshes.distorted_meshes import moved_mesh
from study.meshes.distortion import smooth_distortion
from study.model.discretisation import spaces
from study.model.units import dimensionless
from study.run.store import Result

Array = npt.NDArray[np.float64]

SHEAR = 1.0


def infsup(element: str, n: int) -> Result:
    """A unit square or cube of cells with sides of 1/n, held below."""
    mesh = moved_mesh(element, n)
    state = StressState.SOLID if mesh.geometry.dim == 3 else StressState.PLANE_STRAIN
    body = Body(spaces(element, mesh), Material(3 * SHEAR, 0.5), state)
    W, dim = body.spaces.trial, mesh.geometry.dim
    below = [prescribe(W, k, lambda x: np.isclose(x[dim - 1], 0.0)) for k in range(dim)]
    held = Reduction.dirichlet(W, below)
    b = held.matrix(assemble_matrix(body.stiffness()))
    of_trial, of_weights = (
        held.matrix(assemble_matrix(_inner_product(body, space))) for space in (W, body.spaces.test)
    )
    scalars = {"inf_sup": _least_singular_value(b, of_trial, of_weights)}
    return Result(scalars, dimensionless(scalars), {}, dofs=b.getSize()[0])


def identity(element: str) -> Result:
    """Largest difference of both sides of K = T K_standard, over K, on a distorted square."""
    mesh = move_nodes(triangles(MPI.COMM_SELF, (0.0, 0.0), (1.0, 1.0), (6, 5)), smooth_distortion)
    bodies = [
        Body(spaces(name, mesh), Material(2.0, 0.4999), StressState.PLANE_STRAIN)
        for name in (element, "galerkin-hybrid-T6")
    ]
    K, standard = (assemble_matrix(body.stiffness()) for body in bodies)
    W = bodies[1].spaces.trial
    moved = SubSpace.displacements(W)
    u, p = moved.selection_matrix(), SubSpace.pressure(W).selection_matrix()
    T = force_transfer(moved.space)
    equilibrium = T.matMult(u.matMult(standard))
    scalars = {}
    for name, rows, expected in (
        ("equilibrium", u, equilibrium),
        ("volume", p, p.matMult(standard)),
    ):
        mine = rows.matMult(K)
        expected.axpy(-1.0, mine, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
        scalars[f"{name}_difference"] = float(expected.norm() / mine.norm())
    return Result(scalars, dimensionless(scalars), {})


def _inner_product(body: Body, space: fem.FunctionSpace) -> ufl.Form:
    """Of the norm above, in one of the spaces."""
    u, w = ufl.TrialFunction(space), ufl.TestFunction(space)
    (_, p), (_, q) = ufl.split(u), ufl.split(w)
    strains = ufl.inner(body.strain(u), body.strain(w))
    return (2 * SHEAR * strains + p * q / (2 * SHEAR)) * ufl.dx


def _least_singular_value(b: PETSc.Mat, of_trial: PETSc.Mat, of_weights: PETSc.Mat) -> float:
    """Of a matrix, between the norms of its columns and of its rows."""
    factors = factorise(b).ksp
    inverse, transposed = _applied(factors.solve, b), _applied(factors.solveTranspose, b)
    trial, weights = _applied(of_trial.mult, b), _applied(of_weights.mult, b)
    size = b.getSize()[0]
    # the largest of b^-1 M_w b^-T M_u, whose inverse is that of b^T M_w^-1 b u = s^2 M_u u
    both = LinearOperator(
        (size, size), lambda x: inverse(weights(transposed(trial(np.ravel(x))))), dtype=float
    )
    (largest,) = eigs(both, k=1, which="LM", v0=np.ones(size), return_eigenvectors=False, tol=1e-8)
    factors.destroy()
    return float(1 / np.sqrt(largest.real))


def _applied(
    action: Callable[[PETSc.Vec, PETSc.Vec], None], like: PETSc.Mat
) -> Callable[[Array], Array]:
    """A PETSc operation on arrays (n,)."""
    given, image = like.createVecs()

    def act(x: Array) -> Array:
        given.setArray(x)
        action(given, image)
        return np.array(image.array_r)

    return act
