"""Neo-Hookean bodies at large strains that are deformed by moving rigid tools."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem
from dolfinx.mesh import Mesh
from scipy.spatial import cKDTree

from pw_elements import Spaces, SurfaceNodes, assemble_scalar, assemble_vector
from pw_elements.contact import ContactPair, ContactProblem, Motion
from pw_elements.contact.model import ContactState
from pw_elements.spaces import SubSpace, cell_measure
from study.model.discretisation import make_element_spaces
from study.solutions.calculix.cylinder import BULK_MODULUS

Array = npt.NDArray[np.float64]

POISSONS_RATIO, HYBRID_POISSONS_RATIO = 0.3, 0.4999
MAX_ITERATIONS = 40
"""Largest number of Newton iterations of an increment.

One increment of the standard element takes 25 iterations, which is the library's default limit:
round-off would decide whether the increment is halved, which changes the frictional dissipation."""

MIN_RELATIVE_WEIGHT = 0.02
"""Integral of a weight function, over the largest one, below which a node has no pressure.

Corners of standard tetrahedra have no weight on flat facets, and a small one on curved facets.
"""


def drop_small_weights(weight: Array) -> Array:
    """Replace integrals of weight functions below `MIN_RELATIVE_WEIGHT` by zero."""
    return np.where(weight > MIN_RELATIVE_WEIGHT * weight.max(), weight, 0.0)


def compare_force_over_weight(force: Array, weight: Array, exact: Array) -> dict[str, float]:
    """Return the largest relative error of nodal forces over weights, and of weightless nodes.

    Args:
        force: Normal forces (m,) of nodes whose whole patches are in contact.
        weight: Integrals (m,) of their weight functions.
        exact: Exact pressures (m,) at these nodes.
    """
    has_weight = weight > 0
    pressure = force[has_weight] / weight[has_weight]
    return {
        "force_over_weight_error": float(np.abs(pressure / exact[has_weight] - 1).max()),
        "weightless_nodes": float(np.mean(~has_weight)),
        "weightless_force": float(np.abs(force[~has_weight]).max(initial=0.0) / force.mean()),
    }


def first_lame_constant_over_shear_modulus(poissons_ratio: float) -> float:
    """Return Lamé's first constant lambda divided by the shear modulus."""
    return 2 * poissons_ratio / (1 - 2 * poissons_ratio)


class NeoHookeanBody:
    """Neo-Hookean body of shear modulus 1, discretised with one kind of element.

    Two-dimensional bodies are in plane strain.

    Attributes:
        element: Name of the element.
        dim: Spatial dimension, 2 or 3.
        solution: Function of all unknowns (displacements and, in hybrid elements, pressures).
        residual: Weak form of equilibrium without contact forces.
        displacements: Subspace of the displacements.
        x: Undeformed positions (n, dim) of the nodes.
        is_vertex: Mask (n,) of the nodes that are vertices.
    """

    def __init__(
        self, element: str, mesh: Mesh, degree: int, calculix_energy: bool = False
    ) -> None:
        """Create the body.

        Args:
            element: Name of the element; Poisson's ratio is 0.4999 for hybrid ones, else 0.3.
            mesh: Mesh of one or several bodies.
            degree: Quadrature degree.
            calculix_energy: Whether to use CalculiX' strain energy instead of
                (|F|^2 - dim) / 2 - ln J + lambda / 2 ln(J)^2.
        """
        pair = make_element_spaces(element, mesh)
        self.element, self.dim = element, mesh.geometry.dim
        self.solution = fem.Function(pair.trial)
        self.displacements = SubSpace.displacements(pair.trial)
        space = self.displacements.space
        self.x: Array = space.tabulate_dof_coordinates()[:, : self.dim]
        self.is_vertex = np.zeros(len(self.x), dtype=bool)
        self.is_vertex[space.dofmap.list[:, : self.dim + 1]] = True
        test = ufl.TestFunction(pair.test)
        dx = cell_measure(pair.displacements.test, degree)
        is_hybrid = "hybrid" in element
        lame = first_lame_constant_over_shear_modulus(
            HYBRID_POISSONS_RATIO if is_hybrid else POISSONS_RATIO
        )
        u = ufl.split(self.solution)[0] if is_hybrid else self.solution
        F = ufl.Identity(self.dim) + ufl.grad(u)
        J, inverse = ufl.det(F), ufl.inv(F).T
        energy = (ufl.inner(F, F) - self.dim) / 2 - ufl.ln(J)
        if is_hybrid:
            p, (v, q) = ufl.split(self.solution)[1], ufl.split(test)
            stress = F - inverse - p * J * inverse
            self.residual = (ufl.inner(stress, ufl.grad(v)) - q * (J - 1 + p / lame)) * dx
            self._energy = (energy + p**2 / (2 * lame)) * dx
        elif calculix_energy:
            square = ufl.inner(F, F) + (3 - self.dim)
            shear_stress = J ** (-2 / 3) * (F - square / 3 * inverse)
            stress = shear_stress + BULK_MODULUS * (J - 1) * J * inverse
            self.residual = ufl.inner(stress, ufl.grad(test)) * dx
            distortion = J ** (-2 / 3) * square - 3
            self._energy = (distortion / 2 + BULK_MODULUS / 2 * (J - 1) ** 2) * dx
        else:
            stress = F - inverse + lame * ufl.ln(J) * inverse
            self.residual = ufl.inner(stress, ufl.grad(test)) * dx
            self._energy = (energy + lame / 2 * ufl.ln(J) ** 2) * dx

    @property
    def displacement(self) -> Array:
        """Present displacements (n, dim) of the nodes."""
        return np.asarray(self.solution.x.array[self.displacements.unknowns])

    def strain_energy(self) -> float:
        """Return the strain energy at the present displacements."""
        return assemble_scalar(self._energy)

    def nodal_forces(self) -> Array:
        """Return the forces (n, dim) of supports and tools on the nodes, i.e. the residual."""
        return np.asarray(assemble_vector(self.residual).array_r[self.displacements.unknowns])

    def find_nodes(self, x: Array) -> npt.NDArray[np.int64]:
        """Return the nodes (m,) at undeformed positions (m, dim).

        Raises:
            ValueError: If a position is further than 1e-9 from all nodes.
        """
        distance, node = cKDTree(self.x).query(x)
        if distance.max() > 1e-9:
            raise ValueError(f"a position is {distance.max():.1e} from the nearest node")
        return np.asarray(node)

    def integrate_weights_over_deformed_sides(
        self, sides: Sequence[npt.NDArray[np.int64]]
    ) -> Array:
        """Integrate each node's test function over the deformed facets of its side.

        Args:
            sides: Facets of each side; sides have no common nodes.

        Returns:
            Integrals (n,); those of other nodes, and small ones, are zero.
        """
        make_spaces = Spaces.petrov_galerkin if self.element.startswith("pw") else Spaces.galerkin
        stretch = SurfaceNodes.area_stretch(self.solution)
        scalar_spaces = make_spaces(self.solution.function_space.mesh, 0)
        weights = np.zeros(len(self.x))
        for side in sides:
            surface = SurfaceNodes.from_scalar_spaces(scalar_spaces, side.astype(np.int32), stretch)
            weights[surface.node] = surface.weight_area
        return drop_small_weights(weights)

    def undeformed_and_deformed_weight_integrals(
        self, upper_nodes: npt.NDArray[np.int64]
    ) -> tuple[Array, Array]:
        """Integrate nodes' test functions over the undeformed and over the deformed upper side.

        Args:
            upper_nodes: Nodes (m,) on the upper side.

        Returns:
            The two integrals (m,) of each node's test function.
        """
        mesh, axis, top = self.solution.function_space.mesh, self.dim - 1, self.x[:, -1].max()
        make_spaces = Spaces.petrov_galerkin if self.element.startswith("pw") else Spaces.galerkin
        scalar_spaces = make_spaces(mesh, 0)

        def integrate_weights_over_upper_side(area_stretch: float | ufl.core.expr.Expr) -> Array:
            surface = SurfaceNodes.from_scalar_spaces(
                scalar_spaces, lambda x: np.isclose(x[axis], top), area_stretch
            )
            order = np.argsort(surface.node)
            return surface.weight_area[
                order[np.searchsorted(surface.node, upper_nodes, sorter=order)]
            ]

        return integrate_weights_over_upper_side(1.0), integrate_weights_over_upper_side(
            SurfaceNodes.area_stretch(self.solution)
        )


@dataclass(frozen=True)
class LoadHistory:
    """Contact states at the ends of increments, with strain energies and support forces.

    Args:
        states: States, beginning with the undeformed one.
        strain_energy: Strain energy of each state.
        base_force: Total force (dim,) of the supports on the base in each state.
    """

    states: list[ContactState]
    strain_energy: list[float]
    base_force: list[Array]

    def work_of_contact_forces_on_nodes(self) -> float:
        """Return the work of the contact forces on the nodes' displacements (trapezoidal rule)."""
        work = 0.0
        for start, end in zip(self.states, self.states[1:], strict=False):
            for old, new in zip(start.pairs, end.pairs, strict=True):
                motion = new.displacement - old.displacement
                work += float(np.sum((old.force_vector + new.force_vector) * motion) / 2)
        return work

    def work_of_tool_forces(self) -> float:
        """Return the work of the tools' forces on the tools' translations (trapezoidal rule)."""
        work = 0.0
        for start, end in zip(self.states, self.states[1:], strict=False):
            for old, new in zip(start.pairs, end.pairs, strict=True):
                motion = new.translation - old.translation
                work += float((old.force + new.force) @ motion / 2)
        return work

    def max_force_imbalance_over_last_tool_force(self, components: Sequence[int] = (0, 1)) -> float:
        """Return the largest force imbalance of all states, relative to the last tool force.

        The imbalance is the sum of the forces of tools and base on the body.

        Args:
            components: Force components in which the imbalance is evaluated.
        """
        sums = [
            sum(pair.force for pair in state.pairs) + base_force
            for state, base_force in zip(self.states, self.base_force, strict=True)
        ]
        last = sum(pair.force for pair in self.states[-1].pairs)
        return float(np.abs(np.array(sums)[:, components]).max() / np.linalg.norm(last))


def solve_increments_of_tool_motion(
    rubber: NeoHookeanBody,
    pair: ContactPair,
    supports: list[fem.DirichletBC],
    motions: Sequence[Motion],
    is_base_node: npt.NDArray[np.bool_],
    set_prescribed_displacements: Callable[[int, float], None] | None = None,
) -> LoadHistory:
    """Solve a contact problem for a sequence of tool motions, with one increment per motion.

    Args:
        rubber: Deformable body.
        pair: Contact pair of the body's surface and the rigid tool.
        supports: Prescribed displacements of the body.
        motions: Total motions of the tool at the ends of the increments.
        is_base_node: Mask (n,) of the nodes of the base, whose support forces are summed.
        set_prescribed_displacements: Function (increment number, load factor) that updates the
            prescribed displacements; None if they are constant.
    """
    problem = ContactProblem.of_residual(
        rubber.residual, rubber.solution, supports, pair, max_iterations=MAX_ITERATIONS
    )
    history = LoadHistory([problem.undeformed], [0.0], [np.zeros(rubber.dim)])
    for k, motion in enumerate(motions):
        load = (
            None
            if set_prescribed_displacements is None
            else partial(set_prescribed_displacements, k)
        )
        history.states.append(problem.step(history.states[-1], load, motion))
        history.strain_energy.append(rubber.strain_energy())
        history.base_force.append(rubber.nodal_forces()[is_base_node].sum(axis=0))
    return history
