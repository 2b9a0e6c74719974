"""Interface laws at the contact points of a process, with weights and initial history.

The module guarantees that errors of users' laws are raised on all processes, and that derivatives
have been compared with differences. It assumes that gaps of the undeformed state are known.
"""

from collections.abc import Sequence
from typing import Any

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import ufl
from dolfinx import fem

from pw_elements.arrays import Array, Indices, LocalIndices, Mask
from pw_elements.checks import (
    MAX_RELATIVE_DIFFERENCE_BETWEEN_RANKS,
    call_user_function,
    check_same_values,
    format_points,
    raise_errors_on_all_processes,
)
from pw_elements.contact.interface.law_fields import InterfaceFields
from pw_elements.contact.interface.operators import ContactInterface
from pw_elements.contact.model import (
    ContactPair,
    DeformableSurface,
    InterfaceLaw,
    InterfaceResponse,
    InterfaceValues,
    MatchingNodes,
    SofteningLaw,
    SolutionNotFound,
    evaluate_and_check_shapes,
    find_wrong_derivatives,
)
from pw_elements.elasticity import (
    StressState,
    boundary_measure,
    exterior_facets_with_all_nodes,
)
from pw_elements.spaces import (
    SubSpace,
    assemble_vector,
    is_hybrid,
    read_record,
    scalar_component_space,
    test_space,
)

# Gaps and slips at which derivatives are compared before any computation, relative to the extent of
# the contact nodes; nodal forces are these lengths times a stiffness of 1
_PROBE_SIZES_PER_EXTENT = (1e-6, 1e-4, 1e-2)
_MAX_PROBED_NODES_PER_PROCESS = 50
# Largest part of the softening branch that a node may pass in one step. A state beyond a snap-back
# is at the end of the branch, however small the step is
_MAX_SOFTENED_FRACTION_PER_STEP = 0.25
# Integrals of weight functions that are smaller, relative to the largest one, are round-off. In
# space, lengths of facets may thus differ by a factor of a million
_RELATIVE_ROUND_OFF_OF_WEIGHTS = 1e-13


class InterfaceLawsOfPairs:
    """Interface laws of all pairs at the m contact points of this process.

    Args:
        laws: law of each pair; None for pairs without an interface law.
        pair: (m,), index of the pair of each point.
        position: (m, dim), undeformed positions of the points.
        initial_gap: (m,), gaps of the undeformed state, infinite at points that face nothing.
        weight: (m,), weights of the points.
        comm: communicator of the processes.
        fields: fields of each pair; None for pairs without fields.

    Attributes:
        has_law: (m,), mask of the points with a law.
        n_history: number of columns of a pair's history: the slip since the undeformed state, in
            global components (dim), and the history variables of the law that has most of them.
        initial_history: (m, n_history), history of the undeformed state.
        fields: fields of each pair; None for pairs without fields.
    """

    def __init__(
        self,
        laws: Sequence[InterfaceLaw | None],
        pair: LocalIndices,
        position: Array,
        initial_gap: Array,
        weight: Array,
        comm: MPI.Comm,
        fields: Sequence[InterfaceFields | None],
    ) -> None:
        self._laws = list(laws)
        self.fields: list[InterfaceFields | None] = list(fields)
        self._position, self._weight, self._comm = position, weight, comm
        self._points_of_law = [
            (law, np.flatnonzero(pair == k), fields[k])
            for k, law in enumerate(laws)
            if law is not None
        ]
        self.has_law: Mask = np.isin(pair, [k for k, law in enumerate(laws) if law is not None])
        dim = position.shape[1]
        self.n_history = dim + max(law.n_history for law, _, _ in self._points_of_law)
        self._errors: list[Exception] = []
        self.initial_history: Array = np.zeros((len(pair), self.n_history))
        with raise_errors_on_all_processes(comm):
            for law, points, _ in self._points_of_law:
                finite_gap = np.where(np.isfinite(initial_gap[points]), initial_gap[points], 0.0)
                values = call_user_function(
                    comm, "an interface law", law.initial_history, finite_gap, weight[points]
                )
                end = dim + law.n_history
                self.initial_history[points, dim:end] = np.reshape(
                    values, (len(points), law.n_history)
                )

    def read_fields(self, motion: PETSc.Mat) -> None:
        """Read the present values of the fields of all pairs; collective.

        Args:
            motion: matrix (m dim, n) that turns unknowns into displacements of the points relative
                to the other side.
        """
        for fields in self.fields:
            if fields is not None:
                fields.read(motion)

    def check_derivatives_at_probes(self, max_extent: float) -> None:
        """Raise ValueError if a derivative contradicts differences at random values; collective.

        Args:
            max_extent: largest extent of the contact nodes, to which gaps and slips are scaled.
        """
        dim, generator = self._position.shape[1], np.random.default_rng(1)
        for law, points, fields in self._points_of_law:
            chosen = points[:_MAX_PROBED_NODES_PER_PROCESS]
            m, n = len(chosen), len(_PROBE_SIZES_PER_EXTENT)
            size = max_extent * np.tile(_PROBE_SIZES_PER_EXTENT, m)[:, None]
            gap_slip_force = generator.uniform(-1, 1, (m * n, 2 * dim)) * size
            rows = np.repeat(chosen, n)
            values = InterfaceValues(
                gap=gap_slip_force[:, 0],
                slip=gap_slip_force[:, 1:dim],
                slip_increment=gap_slip_force[:, 1:dim],
                force=gap_slip_force[:, dim:],
                history=self.initial_history[rows, dim : dim + law.n_history],
                weight=self._weight[rows],
                stiffness=np.ones(m * n),
                position=self._position[rows],
                fields=None if fields is None else fields.values[rows],
            )
            self._raise_if_derivatives_are_wrong(law, values)

    def check_derivatives_at_state(
        self,
        frame: Array,
        gap: Array,
        slip: Array,
        force: Array,
        start_history: Array,
        stiffness: Array,
    ) -> None:
        """Raise ValueError if a derivative contradicts differences at a state; collective.

        The arguments are those of `evaluate`.
        """
        for law, points, fields in self._points_of_law:
            values = self._values_at(
                law,
                fields,
                points[np.isfinite(gap[points])],
                (frame, gap, slip, force, start_history, stiffness),
            )
            self._raise_if_derivatives_are_wrong(law, values)

    def _raise_if_derivatives_are_wrong(self, law: InterfaceLaw, values: InterfaceValues) -> None:
        with raise_errors_on_all_processes(self._comm):
            wrong, compared = call_user_function(
                self._comm, "an interface law", find_wrong_derivatives, law, values
            )
            if not wrong.any():
                return
            k = int(wrong.argmax())
            name, given, difference = max(
                compared, key=lambda part: np.nanmax(np.abs(part[1][k] - part[2][k]))
            )
            entry = np.unravel_index(np.nanargmax(np.abs(given[k] - difference[k])), given[k].shape)
            raise ValueError(
                f"an interface law gives {name}[{', '.join(map(str, entry))}] = "
                f"{given[k][entry]:.6g} at the node at {format_points(values.position[[k]])} with "
                f"the gap {values.gap[k]:.6g}, but differences of its force give "
                f"{difference[k][entry]:.6g}: return the derivatives of the force"
            )

    def evaluate(
        self,
        frame: Array,
        gap: Array,
        slip: Array,
        force: Array,
        start_history: Array,
        stiffness: Array,
    ) -> tuple[Mask, InterfaceResponse]:
        """Return the responses of all laws at the points of this process.

        An error of a law is kept, and `raise_kept_error` raises it; forces are then NaN.

        Args:
            frame: (m, dim, dim), normals and tangents as rows.
            gap: (m,), gaps, infinite at points that face nothing. Laws are not evaluated there.
            slip: (m, dim - 1), slips in this increment.
            force: (m, dim), components of the forces in the frames.
            start_history: (m, n_history), history at the start of the increment.
            stiffness: (m,), factor c of implicit laws.

        Returns:
            Mask (m,) of the points at which laws were evaluated, and responses at all m points,
            which are zero at other points. The history is (m, n_history).
        """
        (m, dim), history = force.shape, start_history.copy()
        n_fields = max(0 if fields is None else fields.n_fields for fields in self.fields)
        by_fields = np.zeros((m, dim, n_fields)) if n_fields else None
        response = InterfaceResponse(
            np.zeros((m, dim)),
            np.zeros((m, dim, dim)),
            np.zeros((m, dim, dim)),
            history,
            by_fields,
        )
        evaluated = self.has_law & np.isfinite(gap)
        for law, all_points, fields in self._points_of_law:
            points = all_points[evaluated[all_points]]
            values = self._values_at(
                law, fields, points, (frame, gap, slip, force, start_history, stiffness)
            )
            try:
                result = evaluate_and_check_shapes(law, values)
            except Exception as error:
                self._errors.append(error)
                response.force[points] = np.nan
                continue
            for name in ("force", "by_motion", "by_force"):
                getattr(response, name)[points] = getattr(result, name)
            if by_fields is not None and result.by_fields is not None:
                by_fields[points, :, : result.by_fields.shape[2]] = result.by_fields
            history[points, :dim] = np.einsum("nta,nt->na", frame[points, 1:], values.slip)
            history[points, dim : dim + law.n_history] = result.history
        return evaluated, response

    def _values_at(
        self,
        law: InterfaceLaw,
        fields: InterfaceFields | None,
        points: LocalIndices,
        state: tuple[Array, ...],
    ) -> InterfaceValues:
        frame, gap, slip, force, start_history, stiffness = (part[points] for part in state)
        dim = frame.shape[1]
        start_slip = start_history[:, :dim]
        turned = np.einsum("nta,na->nt", frame[:, 1:], start_slip)
        turned_size = np.linalg.norm(turned, axis=1)
        length_ratio = np.divide(
            np.linalg.norm(start_slip, axis=1),
            turned_size,
            out=np.ones_like(turned_size),
            where=turned_size > 0,
        )
        return InterfaceValues(
            gap=gap,
            slip=length_ratio[:, None] * turned + slip,
            slip_increment=slip,
            force=force,
            history=start_history[:, dim : dim + law.n_history],
            weight=self._weight[points],
            stiffness=stiffness,
            position=self._position[points],
            fields=None if fields is None else fields.values[points],
        )

    def raise_kept_error(self) -> None:
        """Raise an error that a law has raised on any process, on all processes; collective."""

        def raise_last() -> None:
            if self._errors:
                raise self._errors.pop()

        with raise_errors_on_all_processes(self._comm):
            call_user_function(self._comm, "an interface law", raise_last)

    @property
    def may_soften(self) -> bool:
        """Whether any law has a softening branch, as a `SofteningLaw`."""
        return any(isinstance(law, SofteningLaw) for law, _, _ in self._points_of_law)

    def raise_if_softened_too_fast(self, start_history: Array, history: Array) -> None:
        """Raise SolutionNotFound if a node has softened too much in one step; collective.

        Args:
            start_history: (m, n_history), history at the start of the step.
            history: (m, n_history), history at its end.
        """
        too_fast, dim = np.zeros(len(self._position), dtype=bool), self._position.shape[1]
        for law, points, _ in self._points_of_law:
            if isinstance(law, SofteningLaw):
                start, end = (
                    law.softened_fraction(part[points, dim : dim + law.n_history])
                    for part in (start_history, history)
                )
                too_fast[points] = end - start > _MAX_SOFTENED_FRACTION_PER_STEP
        positions = np.concatenate(self._comm.allgather(self._position[too_fast]))
        if len(positions):
            raise SolutionNotFound.with_positions(
                f"the interface law at {{}} softens by more than "
                f"{_MAX_SOFTENED_FRACTION_PER_STEP:.3g} of its range in one step: give smaller "
                "increments",
                positions,
            )

    def sample_responses(self, pair_index: int) -> Array:
        """Return forces of one pair's law at fixed values, by which files are recognised."""
        law, dim = self._laws[pair_index], self._position.shape[1]
        if law is None:
            return np.empty(0)
        sizes = np.array([-1.0, 1e-6, 1e-4, 1e-2, 1.0])
        n, fields = len(sizes), self.fields[pair_index]
        values = InterfaceValues(
            gap=sizes,
            slip=np.tile(sizes[:, None], dim - 1),
            slip_increment=np.tile(sizes[:, None], dim - 1),
            force=np.ones((n, dim)),
            history=law.initial_history(np.zeros(n), np.ones(n)),
            weight=np.ones(n),
            stiffness=np.ones(n),
            position=np.zeros((n, dim)),
            fields=None if fields is None else np.ones((n, fields.n_fields)),
        )
        return evaluate_and_check_shapes(law, values).force.ravel()


def integrate_weight_functions(
    space: fem.FunctionSpace,
    nodes: Indices,
    *,
    is_galerkin: bool,
    is_axisymmetric: bool,
) -> Array:
    """Return integrals (k,) of the weight functions of nodes over the facets they span; collective.

    Integrals that vanish but for round-off, as those of the vertices of standard quadratic
    tetrahedra do, are zero: a force divided by round-off would be no pressure.

    Args:
        space: space of the displacements.
        nodes: (k,), owned nodes of one pair.
        is_galerkin: whether the weight functions are those of the trial space.
        is_axisymmetric: whether areas are those of the whole circumference.
    """
    index_map, comm = space.dofmap.index_map, space.mesh.comm
    all_nodes = np.concatenate(comm.allgather(index_map.local_to_global(nodes)))
    facets = exterior_facets_with_all_nodes(space, all_nodes)
    if comm.allreduce(len(facets), MPI.SUM) == 0:
        return np.zeros(len(nodes))
    scalars = scalar_component_space(space)
    weights = scalars if is_galerkin else test_space(scalars)
    depth: Any = 1.0
    if is_axisymmetric:
        depth = 2 * np.pi * ufl.SpatialCoordinate(space.mesh)[0]
    form = depth * ufl.TestFunction(weights) * boundary_measure(space.mesh, facets)
    integrals = np.array(assemble_vector(form).array_r[nodes])
    sizes = np.abs(integrals)
    largest = comm.allreduce(sizes.max(initial=0.0), MPI.MAX)
    return np.where(sizes > _RELATIVE_ROUND_OFF_OF_WEIGHTS * largest, integrals, 0.0)


def describe_weight_functions(
    K: PETSc.Mat, pairs: Sequence[ContactPair], space: fem.FunctionSpace
) -> dict[str, bool]:
    """Return the keyword arguments of `make_interface_laws` for an assembled stiffness.

    Args:
        K: stiffness (n, n).
        pairs: contact pairs.
        space: trial space.

    Raises:
        ValueError: if a pair has an interface law, and the weight functions are unknown or the
            stiffness is that of the symmetric sibling element.
    """
    record = read_record(K)
    test, has_law = record.test_space, any(pair.interface_law is not None for pair in pairs)
    if has_law and test is None:
        raise ValueError(
            "the stiffness has no record of its weight functions, whose integrals are the weights "
            "of an interface law: assemble it by assemble_matrix"
        )
    if has_law and record.sibling is not None:
        raise ValueError(
            "the symmetrised stiffness has other unknowns than displacements, of which interface "
            "laws are functions: give the stiffness of the body"
        )
    if not has_law or test is None:
        return {"is_galerkin": True, "is_axisymmetric": False}
    displacements = SubSpace.displacements(space).space
    if is_hybrid(space):
        test = test.sub([0])
    weight_functions, trial_functions = (
        part.element.basix_element.tabulate(0, np.eye(1, space.mesh.topology.dim) / 4)
        for part in (test, displacements)
    )
    # piecewise-linear and quadratic functions differ at a quarter of an edge
    is_galerkin = weight_functions.shape == trial_functions.shape and np.allclose(
        weight_functions, trial_functions
    )
    return {
        "is_galerkin": bool(is_galerkin),
        "is_axisymmetric": StressState.AXISYMMETRIC.value in record.stress_states,
    }


def make_interface_laws(
    pairs: Sequence[ContactPair],
    interface: ContactInterface,
    *,
    is_galerkin: bool,
    is_axisymmetric: bool,
) -> InterfaceLawsOfPairs | None:
    """Return the interface laws of all pairs, or None if no pair has one; collective.

    Args:
        pairs: contact pairs.
        interface: contact points of all pairs.
        is_galerkin: whether the weight functions are those of the trial space.
        is_axisymmetric: whether areas are those of the whole circumference.

    Raises:
        ValueError: if a law fails, if differences contradict its derivatives, or if a field belongs
            to another mesh.
    """
    laws = [pair.interface_law for pair in pairs]
    if all(law is None for law in laws):
        return None
    space, weight = interface.field.space, np.zeros(len(interface.pair))
    for k, law in enumerate(laws):
        if law is not None:
            points = interface.pair == k
            weight[points] = integrate_weight_functions(
                space,
                interface.local_node_indices[points],
                is_galerkin=is_galerkin,
                is_axisymmetric=is_axisymmetric,
            )
    weight *= interface.facing_fraction
    initial_gap = interface.evaluate_undeformed_gaps_and_normals(None)[0]
    fields = [_make_fields_of_pair(pair, interface) for pair in pairs]
    laws_of_pairs = InterfaceLawsOfPairs(
        laws, interface.pair, interface.position, initial_gap, weight, interface.comm, fields
    )
    laws_of_pairs.check_derivatives_at_probes(interface.max_extent_of_points or 1.0)
    if interface.comm.size > 1:
        samples = {
            f"the interface law of contact pair {k}": laws_of_pairs.sample_responses(k)
            for k in range(len(laws))
        }
        check_same_values(interface.comm, samples, MAX_RELATIVE_DIFFERENCE_BETWEEN_RANKS)
    return laws_of_pairs


def _make_fields_of_pair(pair: ContactPair, interface: ContactInterface) -> InterfaceFields | None:
    if pair.interface_fields is None:
        return None
    for name, function in pair.interface_fields.items():
        if function.function_space.mesh is not interface.field.space.mesh:
            raise ValueError(
                f"interface field {name!r} is on another mesh: make its space on the mesh of the "
                "body, and interpolate the values"
            )
    faces_body = isinstance(pair.surface, DeformableSurface | MatchingNodes)
    return InterfaceFields(pair.interface_fields, interface, faces_body=faces_body)
