"""Large strains of incompressible bodies in hybrid spaces, by their residual."""

from mpi4py import MPI

import numpy as np
import pytest
import ufl
from dolfinx import fem
from dolfinx.mesh import CellType, create_box, create_rectangle, meshtags

from pw_elements import PetrovGalerkinProblem, Spaces, prescribe
from pw_elements.meshes import curved, triangles
from pw_elements.spaces import SubSpace

COMM = MPI.COMM_SELF
MAKERS = {"new": Spaces.hybrid, "standard": Spaces.taylor_hood}
DX = ufl.dx(metadata={"quadrature_degree": 6})


def block(dim, n):
    """A unit square or cube whose inner nodes are moved."""
    cell = CellType.triangle if dim == 2 else CellType.tetrahedron
    build = create_rectangle if dim == 2 else create_box
    mesh = build(COMM, [(0.0,) * dim, (1.0,) * dim], [n] * dim, cell)
    x = mesh.geometry.x[:, :dim]
    inner = np.all((x > 1e-9) & (x < 1 - 1e-9), axis=1)
    x[inner] += 0.15 / n * np.sin(9 * x + 5 * np.roll(x, 1, axis=1))[inner]
    return mesh


class Rubber:
    """A neo-Hookean body whose shear modulus is mu and whose volume stays, p = 0 at rest."""

    def __init__(self, spaces, mu=1.0):
        self.space, self.w, self.mu = spaces.trial, fem.Function(spaces.trial), mu
        self.fields = [SubSpace.displacements(self.space), SubSpace.pressure(self.space)]
        self.dim = self.space.mesh.geometry.dim
        self.v, self.q = ufl.split(ufl.TestFunction(spaces.test))

    @property
    def residual(self):
        u, p = ufl.split(self.w)
        F = ufl.Identity(self.dim) + ufl.grad(u)
        J, inverse = ufl.det(F), ufl.inv(F).T
        stress = self.mu * (F - inverse) - p * J * inverse
        return ufl.inner(stress, ufl.grad(self.v)) * DX - self.q * (J - 1) * DX

    def field(self, k):
        """Values (nodes, components) of displacement or pressure, and the nodes' positions."""
        part = self.fields[k]
        x = part.space.tabulate_dof_coordinates()[:, : self.dim]
        return self.w.x.array[part.unknowns], x

    def forces(self, problem):
        return problem.reactions().array_r[self.fields[0].owned]


@pytest.mark.parametrize("mu", [1.0, 7e10])
@pytest.mark.parametrize("method", MAKERS)
def test_an_incompressible_block_is_stretched_exactly_whatever_the_units(method, mu):
    """sigma = mu (l^2 - l^-2) in plane strain."""
    size, stretch = 1e-3, 1.4
    mesh = block(2, 3)
    mesh.geometry.x[:] *= size
    rubber = Rubber(MAKERS[method](mesh), mu)
    end = fem.Constant(mesh, (stretch - 1) * size)

    def side(axis, place):
        return lambda x: np.isclose(x[axis], place * size)

    conditions = [prescribe(rubber.space, k, side(k, 0.0)) for k in (0, 1)]
    conditions.append(prescribe(rubber.space, 0, side(0, 1.0), end))
    problem = PetrovGalerkinProblem(rubber.residual, rubber.w, conditions)
    problem.solve(end, increments=2)
    moved, x = rubber.field(0)
    exact = x * (stretch - 1, 1 / stretch - 1)
    assert np.abs(moved - exact).max() < 1e-9 * size
    pressure, _ = rubber.field(1)
    # the transverse stress mu (l^-2 - 1) - p vanishes
    assert np.abs(pressure - mu * (stretch**-2 - 1)).max() < 1e-8 * mu
    force = rubber.forces(problem)[np.isclose(x[:, 0], size)].sum(axis=0)
    expected = mu * (stretch**2 - stretch**-2) * size / stretch
    assert force == pytest.approx([expected, 0.0], abs=1e-8 * expected)


def quarter_ring(method, n):
    """Force, over its exact value, that widens the hole of an incompressible ring to 3/2."""
    angle = np.pi / 2

    def around(x):
        r, a = 1 + x[:, 0], angle * x[:, 1]
        return np.column_stack([r * np.cos(a), r * np.sin(a), 0 * a])

    mesh = curved(triangles(COMM, (0.0, 0.0), (1.0, 1.0), (n, n)), around)
    rubber = Rubber(MAKERS[method](mesh))
    share = fem.Constant(mesh, 0.5)

    def hole(x):
        return np.hypot(x[0], x[1]) < 1 + 1e-9

    conditions = [prescribe(rubber.space, k, lambda x, k=k: np.isclose(x[k], 0.0)) for k in (0, 1)]
    moved = fem.Function(rubber.fields[0].space)
    x = moved.function_space.tabulate_dof_coordinates()
    at = np.flatnonzero(hole(x.T))
    dofs = (at[:, None] * 2 + (0, 1)).ravel().astype(np.int32)
    own = rubber.fields[0].unknowns[at].ravel().astype(np.int32)
    conditions.append(fem.dirichletbc(moved, [own, dofs], rubber.space.sub(0)))

    def widen(to):
        moved.x.array[dofs] = (to * share.value * x[at, :2]).ravel()

    problem = PetrovGalerkinProblem(rubber.residual, rubber.w, conditions)
    problem.solve(widen, increments=3)
    forces = rubber.forces(problem)[at]
    push = np.sum(forces * x[at, :2])  # on radii of 1
    inner, outer = 1.5, np.sqrt(1.5**2 + 3) / 2
    pressure = np.log(inner / outer) - (inner**-2 - outer**-2) / 2
    return push / (pressure * 1.5 * angle)


@pytest.mark.parametrize("method", MAKERS)
def test_a_ring_is_widened_by_the_pressure_that_is_known(method):
    coarse, fine = (abs(quarter_ring(method, n) - 1) for n in (4, 8))
    # piecewise-linear weights are radial up to second order
    assert fine < (1e-3 if method == "new" else 1e-5)
    assert coarse / fine > (2**1.9 if method == "new" else 2**3.8)


def pressed(method, dim):
    """A block between plates that stick, pressed and sheared; and its problem."""
    mesh = block(dim, 5 if dim == 2 else 2)
    rubber = Rubber(MAKERS[method](mesh))
    moves = [fem.Constant(mesh, value) for value in (0.1, *[0.05] * (dim - 2), -0.2)]
    ends = [(lambda x, end=end: np.isclose(x[dim - 1], end)) for end in (0.0, 1.0)]
    conditions = [prescribe(rubber.space, k, ends[0]) for k in range(dim)]
    conditions += [prescribe(rubber.space, k, ends[1], move) for k, move in enumerate(moves)]
    problem = PetrovGalerkinProblem(rubber.residual, rubber.w, conditions)
    problem.solve(moves)
    return rubber, problem


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("method", MAKERS)
def test_forces_turn_with_the_body_and_balance(method, dim):
    rubber, problem = pressed(method, dim)
    (increment,) = problem.increments  # Newton's method is quadratic
    assert len(increment.corrections) == 5
    assert increment.corrections[-1] < 5 * increment.corrections[-2] ** 2
    moved, x = rubber.field(0)
    forces = rubber.forces(problem)
    size = np.abs(forces).max()
    held = np.isclose(x[:, dim - 1], 0.0) | np.isclose(x[:, dim - 1], 1.0)
    assert np.abs(forces[~held]).max() < 1e-8 * size
    assert np.abs(forces.sum(axis=0)).max() < 1e-10 * size
    turn = np.array([[0.6, -0.8], [0.8, 0.6]])
    if dim == 3:
        turn = np.array([[2, -1, 2], [2, 2, -1], [-1, 2, 2]]) / 3
    rubber.w.x.array[rubber.fields[0].unknowns] = (x + moved) @ turn.T - x
    turned = rubber.forces(problem)
    assert np.abs(turned - forces @ turn.T).max() < 1e-12 * size


def test_a_split_pressure_is_refused():
    mesh = triangles(COMM, (0.0, 0.0), (1.0, 1.0), (2, 2))
    cells = np.arange(mesh.topology.index_map(2).size_local, dtype=np.int32)
    rubber = Rubber(Spaces.hybrid(mesh, meshtags(mesh, 2, cells, cells)))
    with pytest.raises(ValueError, match="no residual ties it"):
        PetrovGalerkinProblem(rubber.residual, rubber.w)
