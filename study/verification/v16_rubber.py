"""Neo-Hookean blocks, their energy, and their way below rigid tools: for section V16."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

from mpi4py import MPI

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem
from dolfinx.mesh import Mesh

from pw_elements import Spaces, SurfaceNodes, assemble_scalar, assemble_vector
from pw_elements.contact import ContactPair, ContactProblem, Motion
from pw_elements.contact.model import ContactState
from pw_elements.spaces import SubSpace, cell_measure
from study.meshes.line_mesh import on_lines
from study.meshes.mesh_lines import growing
from study.meshes.solid_meshes import box
from study.model.discretisation import spaces
from study.solutions.calculix.cylinder import BULK, block_lines

Array = npt.NDArray[np.float64]

# Lengths over the tool's radius, stresses over the shear modulus; plane strain in the plane.
# Half width and height of a block, and the half width with elements of one size
SPACE_WIDTH, SPACE_HEIGHT, SPACE_FINE, SPACE_GROWTH = 1.8, 1.4, 0.85, 1.8
RATIO, HYBRID_RATIO = 0.3, 0.4999  # Poisson's
DEGREE = {2: 4, 3: 2}  # of quadrature
# One increment of the standard element takes 25, the library's default: round-off would decide
# whether it is cut, and with it what friction dissipates
MAX_ITERATIONS = 40


class Rubber:
    """A neo-Hookean block on an element.

    Attributes:
        w: all unknowns.
        residual: without what tools exert.
        field: displacements among the unknowns.
        x: (n, dim), nodes.
        corner: (n,), which of them are vertices.
    """

    def __init__(self, element: str, mesh: Mesh, peer: bool = False) -> None:
        """With the energy of section V16, or with that of CalculiX (plane strain)."""
        pair = spaces(element, mesh)
        self.element, self.dim = element, mesh.geometry.dim
        self.w, self.field = fem.Function(pair.trial), SubSpace.displacements(pair.trial)
        self.x: Array = self.field.space.tabulate_dof_coordinates()[:, : self.dim]
        self.corner = np.zeros(len(self.x), dtype=bool)
        self.corner[self.field.space.dofmap.list[:, : self.dim + 1]] = True
        test = ufl.TestFunction(pair.test)
        dx = cell_measure(pair.displacements.test, DEGREE[self.dim])
        hybrid = "hybrid" in element
        nu = HYBRID_RATIO if hybrid else RATIO
        lame = 2 * nu / (1 - 2 * nu)
        u = ufl.split(self.w)[0] if hybrid else self.w
        F = ufl.Identity(self.dim) + ufl.grad(u)
        J, inverse = ufl.det(F), ufl.inv(F).T
        energy = (ufl.inner(F, F) - self.dim) / 2 - ufl.ln(J)
        if hybrid:
            p, (v, q) = ufl.split(self.w)[1], ufl.split(test)
            stress = F - inverse - p * J * inverse
            self.residual = (ufl.inner(stress, ufl.grad(v)) - q * (J - 1 + p / lame)) * dx
            self._energy = (energy + p**2 / (2 * lame)) * dx
        elif peer:
            shear = J ** (-2 / 3) * (F - (ufl.inner(F, F) + 1) / 3 * inverse)
            stress = shear + BULK * (J - 1) * J * inverse
            self.residual = ufl.inner(stress, ufl.grad(test)) * dx
            distortion = J ** (-2 / 3) * (ufl.inner(F, F) + 1) - 3
            self._energy = (distortion / 2 + BULK / 2 * (J - 1) ** 2) * dx
        else:
            stress = F - inverse + lame * ufl.ln(J) * inverse
            self.residual = ufl.inner(stress, ufl.grad(test)) * dx
            self._energy = (energy + lame / 2 * ufl.ln(J) ** 2) * dx

    @property
    def displacement(self) -> Array:
        """Of the nodes, (n, dim)."""
        return np.asarray(self.w.x.array[self.field.unknowns])

    def stored(self) -> float:
        """Energy of the block as it is."""
        return assemble_scalar(self._energy)

    def forces(self) -> Array:
        """Forces (n, dim) of supports and tools on the nodes."""
        return np.asarray(assemble_vector(self.residual).array_r[self.field.unknowns])

    def areas(self, nodes: npt.NDArray[np.int64]) -> tuple[Array, Array]:
        """What weights of nodes (m,) of the upper side integrate to, undeformed and deformed."""
        mesh, axis, top = self.w.function_space.mesh, self.dim - 1, self.x[:, -1].max()
        way = Spaces.petrov_galerkin if self.element.startswith("pw") else Spaces.galerkin
        scalars = way(mesh, 0)

        def of(stretch: float | ufl.core.expr.Expr) -> Array:
            surface = SurfaceNodes.from_scalar_spaces(
                scalars, lambda x: np.isclose(x[axis], top), stretch
            )
            order = np.argsort(surface.node)
            return surface.weight_area[order[np.searchsorted(surface.node, nodes, sorter=order)]]

        return of(1.0), of(SurfaceNodes.stretch(self.w))


@dataclass(frozen=True)
class Run:
    """States at the ends of increments, the undeformed one first, and what belongs to each.

    Args:
        states: of the contact problem.
        stored: energy.
        base: total force (dim,) of the supports below.
    """

    states: list[ContactState]
    stored: list[float]
    base: list[Array]

    def work(self) -> float:
        """Of contact forces on nodes, by the trapezoidal rule."""
        total = 0.0
        for before, after in zip(self.states, self.states[1:], strict=False):
            for old, new in zip(before.pairs, after.pairs, strict=True):
                way = new.displacement - old.displacement
                total += float(np.sum((old.force_vector + new.force_vector) * way) / 2)
        return total

    def tools_work(self) -> float:
        """Of tools, likewise."""
        total = 0.0
        for before, after in zip(self.states, self.states[1:], strict=False):
            for old, new in zip(before.pairs, after.pairs, strict=True):
                way = new.translation - old.translation
                total += float((old.force + new.force) @ way / 2)
        return total

    def base_defect(self, components: Sequence[int] = (0, 1)) -> float:
        """Largest sum of the forces of tools and base, over the last force of the tools."""
        sums = [
            sum(pair.force for pair in state.pairs) + below
            for state, below in zip(self.states, self.base, strict=True)
        ]
        last = sum(pair.force for pair in self.states[-1].pairs)
        return float(np.abs(np.array(sums)[:, components]).max() / np.linalg.norm(last))


def follow(
    rubber: Rubber,
    pair: ContactPair,
    held: list[fem.DirichletBC],
    motions: Sequence[Motion],
    base: npt.NDArray[np.bool_],
    loading: Callable[[int, float], None] | None = None,
) -> Run:
    """A tool's way.

    Args:
        rubber: the block.
        pair: the tool.
        held: supports.
        motions: at the ends of the increments.
        base: marks the nodes (n,) of which supports are summed.
        loading: sets prescribed displacements by an increment's number and its share.
    """
    problem = ContactProblem.of_residual(
        rubber.residual, rubber.w, held, pair, max_iterations=MAX_ITERATIONS
    )
    run = Run([problem.undeformed], [0.0], [np.zeros(rubber.dim)])
    for k, motion in enumerate(motions):
        load = None if loading is None else partial(loading, k)
        run.states.append(problem.step(run.states[-1], load, motion))
        run.stored.append(rubber.stored())
        run.base.append(rubber.forces()[base].sum(axis=0))
    return run


def block(elements: int) -> Mesh:
    """A block below a cylinder, with so many elements along its radius."""
    return on_lines(MPI.COMM_SELF, *block_lines(elements), "triangle")


def cube(elements: int, half: bool) -> Mesh:
    """A quarter of a block below a sphere, or a half of one."""
    size = 1 / elements
    near = np.linspace(0, SPACE_FINE, round(SPACE_FINE * elements) + 1)
    far = near[-1] + growing(size, SPACE_WIDTH - near[-1], SPACE_GROWTH)[1:]
    y = np.concatenate([near, far])
    x = np.concatenate([-y[:0:-1], y]) if half else y
    return box("tetrahedron", x, y, -growing(size, SPACE_HEIGHT, SPACE_GROWTH)[::-1])
