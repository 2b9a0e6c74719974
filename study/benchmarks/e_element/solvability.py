"""Stiffness matrices of many small meshes, and how far they are from singular ones.

All meshes of an element have one topology, so that their matrices are computed together by NumPy.
A test compares them with the library's matrices on single meshes.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from itertools import permutations, product
from typing import Any, Literal

from mpi4py import MPI

import basix
import basix.ufl
import numpy as np
import numpy.typing as npt
import scipy.linalg
from dolfinx.mesh import Mesh, create_mesh

from pw_elements import (
    Body,
    Material,
    Reduction,
    Sibling,
    Spaces,
    assemble_matrix,
    force_transfer,
    lumped_mass,
    prescribe,
)
from pw_elements.elasticity import StressState
from pw_elements.spaces import piecewise_linear_sub_cell_element, quadratic_element
from pw_elements.spaces.elements import tetrahedron_twelve_cell_quadrature
from study.model.matrices import to_dense_array
from study.model.units import assign_unit_one_to_scalars
from study.run.store import Result

Array = npt.NDArray[Any]
Indices = npt.NDArray[np.int64]
Geometry = Literal["affine", "straight", "curved"]
Shape = Literal["layers", "columns", "needles"]

CELL_BY_ELEMENT = {
    "T6": "triangle",
    "Q8": "triangle",
    "Q9": "quadrilateral",
    "T10": "tetrahedron",
    "H27": "hexahedron",
}
CELLS_PER_SIDE = {2: 4, 3: 2}
"""Number of squares or cubes along a side of the meshed unit square or cube, by dimension."""
QUADRATURE_DEGREE: dict[Geometry, int] = {"affine": 5, "straight": 5, "curved": 8}
"""Degree of the quadrature rule on each sub-cell: the library's degree on such cells."""


@dataclass(frozen=True)
class MeshParameters:
    """Parameters of a mesh of the unit square or cube that is stretched and distorted at random.

    Attributes:
        element: Name of the element, a key of `CELL_BY_ELEMENT`.
        geometry: "affine" for a regular mesh that is mapped linearly, "straight" for shifted
            vertices, "curved" for shifted mid-side, face and centre nodes as well.
        shape: How the mesh is stretched. "layers": along an axis of the clamped base; "columns":
            away from the base; shifts are then relative to the shortest side of a cell, so that
            angles stay away from 180 degrees. "needles": along any axis after the shifts, so that
            angles approach 180 degrees.
        aspect_ratio: Factor of the stretch.
        shift: Largest random shift along each axis, relative to a side of a cell. In curved meshes
            vertices are shifted by `VERTEX_SHIFT_OF_CURVED_MESHES`. In affine meshes it is the
            largest entry of the linear map less the unit matrix.
        seed: Seed of the random numbers, which also selects the axis of the stretch.
    """

    element: str
    geometry: Geometry
    shape: Shape
    aspect_ratio: float
    shift: float
    seed: int


VERTEX_SHIFT_OF_CURVED_MESHES = 0.1
MAX_TRIALS_PER_MESH = 500
"""Number of random distortions that are tried until no cell has a point with det J <= 0."""


@dataclass(frozen=True)
class Topology:
    """Nodes of the quadratic cells of a unit square or cube.

    Attributes:
        lattice: Integer coordinates (n, dim) of the nodes; those of vertices are even.
        cells: Numbers of the nodes (cells, nodes per cell), in Basix's order.
        corner_weights: Matrix (nodes per cell, vertices) that interpolates between the vertices.
        base: Mask (n,) of nodes in the base, whose last coordinate is 0.
    """

    lattice: Indices
    cells: Indices
    corner_weights: Array
    base: npt.NDArray[np.bool_]


@cache
def make_topology(cell: str, n: int) -> Topology:
    """Divide the unit square or cube into n squares or cubes per side, and these into cells."""
    kind = basix.CellType[cell]
    dim = len(basix.topology(kind)) - 1
    if cell in ("quadrilateral", "hexahedron"):
        corners = [np.array([2 * v for v in basix.geometry(kind)], dtype=int)]
    else:  # one simplex for each order of the axes, along a path from one end to the other
        paths = [np.eye(dim, dtype=int)[list(order)] for order in permutations(range(dim))]
        corners = [2 * np.vstack([np.zeros(dim, dtype=int), path.cumsum(axis=0)]) for path in paths]
        for simplex in corners:
            if np.linalg.det(simplex[1:] - simplex[0]) < 0:
                simplex[[1, 2]] = simplex[[2, 1]]
    points = basix.create_element(basix.ElementFamily.P, kind, 2).points
    linear = basix.create_element(basix.ElementFamily.P, kind, 1)
    weights = linear.tabulate(0, points)[0, :, :, 0]
    origins = 2 * np.array(list(product(range(n), repeat=dim)))
    in_square = np.rint(weights @ np.array(corners)).astype(int)
    positions = (origins[:, None, None] + in_square).reshape(-1, len(points), dim)
    shape = (2 * n + 1,) * dim
    cells = np.ravel_multi_index(tuple(np.moveaxis(positions, -1, 0)), shape)
    lattice = np.array(list(np.ndindex(shape)))
    used, cells = np.unique(cells, return_inverse=True)
    lattice = lattice[used]
    return Topology(lattice, cells.reshape(positions.shape[:2]), weights, lattice[:, -1] == 0)


def topology_of(element: str) -> Topology:
    """Return the topology of the meshes of an element."""
    cell = CELL_BY_ELEMENT[element]
    dim = 3 if cell in ("tetrahedron", "hexahedron") else 2
    return make_topology(cell, CELLS_PER_SIDE[dim])


def make_cell_nodes(mesh: MeshParameters) -> Array:
    """Return the positions (cells, nodes per cell, dim) of the nodes of a distorted mesh.

    Raises:
        ValueError: If no mesh without inverted cells is found.
    """
    topology = topology_of(mesh.element)
    lattice, cells = topology.lattice, topology.cells
    n_vertices, dim = topology.corner_weights.shape[1], lattice.shape[1]
    stretch = np.ones(dim)
    n_axes = {"layers": dim - 1, "columns": 1, "needles": dim}[mesh.shape]
    stretch[-1 if mesh.shape == "columns" else mesh.seed % n_axes] = mesh.aspect_ratio
    before, after = (stretch, 1.0) if mesh.shape != "needles" else (1.0, stretch)
    cell_size = 1 / CELLS_PER_SIDE[dim]
    is_curved, is_affine = mesh.geometry == "curved", mesh.geometry == "affine"
    vertex_shift = VERTEX_SHIFT_OF_CURVED_MESHES if is_curved else 0.0 if is_affine else mesh.shift
    is_vertex = np.zeros(len(lattice), dtype=bool)
    is_vertex[cells[:, :n_vertices]] = True
    stays_straight = is_vertex | (_is_inner_node_of_q8(topology) & (mesh.element == "Q8"))
    rng = np.random.default_rng(mesh.seed)
    cell, degree = CELL_BY_ELEMENT[mesh.element], QUADRATURE_DEGREE[mesh.geometry]
    table = np.hstack([slopes_at_nodes(cell), tabulate(cell, degree).shape_slopes])
    for _ in range(MAX_TRIALS_PER_MESH):
        shifts = rng.uniform(-1, 1, lattice.shape) * cell_size
        shifts[topology.base, -1] = 0.0
        x = lattice * before * cell_size / 2 + vertex_shift * shifts
        nodes = np.einsum("iv,cvd->cid", topology.corner_weights, x[cells[:, :n_vertices]])
        if is_curved:
            nodes += mesh.shift * np.where(stays_straight[:, None], 0.0, shifts)[cells]
        if is_affine:
            nodes = nodes @ (np.eye(dim) + mesh.shift * rng.uniform(-1, 1, (dim, dim)))
        jacobians = np.einsum("cnd,rqn->cqdr", nodes, table)
        if np.linalg.det(jacobians).min() > 0:
            return np.asarray(nodes * after)
    raise ValueError(f"each of {MAX_TRIALS_PER_MESH} distorted meshes has inverted cells: {mesh}")


@cache
def slopes_at_nodes(cell: str) -> Array:
    """Return the slopes (dim, q, nodes) of shape functions at nodes and in the middle of sides."""
    kind = basix.CellType[cell]
    corners, dim = basix.geometry(kind), len(basix.topology(kind)) - 1
    sides = [corners[side].mean(axis=0) for side in basix.topology(kind)[dim - 1]]
    points = np.vstack([basix.create_element(basix.ElementFamily.P, kind, 2).points, sides])
    return np.asarray(quadratic_element(cell).tabulate(1, points)[1 : dim + 1])


def _is_inner_node_of_q8(topology: Topology) -> npt.NDArray[np.bool_]:
    """Return a mask (n,) of the nodes in the middle of squares, which are condensed in Q8."""
    return np.asarray((topology.lattice % 2 == 1).all(axis=1))


@dataclass(frozen=True)
class TabulatedCell:
    """Functions of a cell at the points of a quadrature rule.

    Attributes:
        weights: Weights (q,) of the rule.
        shape_slopes: Slopes (dim, q, nodes) of the shape functions.
        test_values: Values (q, nodes) of the weight functions.
        test_slopes: Slopes (dim, q, nodes) of the weight functions.
        pressure_values: Values (q, vertices) of the functions of the pressure.
    """

    weights: Array
    shape_slopes: Array
    test_values: Array
    test_slopes: Array
    pressure_values: Array


@cache
def tabulate(cell: str, degree: int, has_new_weights: bool = True) -> TabulatedCell:
    """Tabulate the functions of a cell: new weights on sub-cells, or standard ones on the cell."""
    kind = basix.CellType[cell]
    if cell == "tetrahedron" and has_new_weights:
        points, weights = tetrahedron_twelve_cell_quadrature(degree)
    else:
        polyset = basix.PolysetType.macroedge if has_new_weights else basix.PolysetType.standard
        points, weights = basix.make_quadrature(kind, degree, polyset_type=polyset)
    shapes = quadratic_element(cell).tabulate(1, points)
    test = (
        piecewise_linear_sub_cell_element(cell).tabulate(1, points) if has_new_weights else shapes
    )
    pressure = basix.create_element(basix.ElementFamily.P, kind, 1).tabulate(0, points)
    axes = slice(1, points.shape[1] + 1)
    return TabulatedCell(weights, shapes[axes], test[0], test[axes], pressure[0, :, :, 0])


@dataclass(frozen=True)
class LameMatrices:
    """Matrices of a clamped mesh for Lamé's constants 1.

    With constants mu and lambda, stiffness is mu `shear` + lambda `bulk`. Of the displacements with
    a pressure p, equilibrium is mu `shear` u - `gradient` p, and volume `divergence` u +
    `pressure` p / lambda.

    Attributes:
        shear: Matrix (n, n) of 2 eps(N):eps(W).
        bulk: Matrix (n, n) of div N div W.
        gradient: Matrix (n, vertices) of q div W.
        divergence: Matrix (vertices, n) of q div N.
        pressure: Matrix (vertices, vertices) of p q.
        load: Vector (n,) of a uniform body force 1 along the first axis.
    """

    shear: Array
    bulk: Array
    gradient: Array
    divergence: Array
    pressure: Array
    load: Array

    def stiffness(self, nu: float) -> Array:
        """Return the stiffness matrix (n, n) of displacements for the shear modulus 1."""
        return self.shear + 2 * nu / (1 - 2 * nu) * self.bulk


def assemble(mesh: MeshParameters, has_new_weights: bool) -> LameMatrices:
    """Assemble the matrices of a mesh with new weight functions or, if not, the standard ones."""
    topology = topology_of(mesh.element)
    cells, dim = topology.cells, topology.lattice.shape[1]
    n_nodes, n_vertices = len(topology.lattice), topology.corner_weights.shape[1]
    table = tabulate(
        CELL_BY_ELEMENT[mesh.element], QUADRATURE_DEGREE[mesh.geometry], has_new_weights
    )
    pressure = table.pressure_values
    nodes = make_cell_nodes(mesh)
    jacobians = np.einsum("cnd,rqn->cqdr", nodes, table.shape_slopes)
    determinants, inverse = np.linalg.det(jacobians), np.linalg.inv(jacobians)
    n_cells, n_points = determinants.shape
    dx = table.weights * determinants

    def slopes(reference: Array) -> Array:
        """Return slopes in space (cells, q, nodes per cell * dim)."""
        return np.einsum("rqn,cqrd->cqnd", reference, inverse).reshape(n_cells, n_points, -1)

    trial, test = slopes(table.shape_slopes), slopes(table.test_slopes)
    n_local = cells.shape[1]
    G = (test * dx[..., None]).transpose(0, 2, 1) @ trial
    bulk = G.reshape(n_cells, n_local, dim, n_local, dim)
    shear = np.einsum("ciajb->cibja", bulk) + np.einsum("cikjk,ab->ciajb", bulk, np.eye(dim))
    divergence = np.einsum("qp,cq,cqk->cpk", pressure, dx, trial)
    gradient = np.einsum("qp,cq,cqk->ckp", pressure, dx, test)
    mass = np.einsum("qp,cq,qr->cpr", pressure, dx, pressure)

    unknowns = (cells[:, :, None] * dim + np.arange(dim)).reshape(n_cells, -1)
    vertices, vertex_numbers = np.unique(cells[:, :n_vertices], return_inverse=True)
    vertex_numbers = vertex_numbers.reshape(n_cells, n_vertices)
    free = np.repeat(~topology.base, dim)
    sizes = {"u": n_nodes * dim, "p": len(vertices)}
    numbers = {"u": unknowns, "p": vertex_numbers}
    keep = {"u": free, "p": np.ones(len(vertices), dtype=bool)}

    def add(blocks: Array, rows: str, columns: str) -> Array:
        matrix = np.zeros((sizes[rows], sizes[columns]))
        np.add.at(matrix, (numbers[rows][:, :, None], numbers[columns][:, None, :]), blocks)
        return np.asarray(matrix[np.ix_(keep[rows], keep[columns])])

    load = np.zeros((n_nodes, dim))
    np.add.at(load[:, 0], cells, np.einsum("cq,qi->ci", dx, table.test_values))
    shape = (n_cells, n_local * dim, n_local * dim)
    return LameMatrices(
        add(shear.reshape(shape), "u", "u"),
        add(bulk.reshape(shape), "u", "u"),
        add(gradient, "u", "p"),
        add(divergence, "p", "u"),
        add(mass, "p", "p"),
        load.ravel()[free],
    )


@dataclass(frozen=True)
class Solvability:
    """How far a matrix is from a singular one, in the standard element's energy norm.

    Attributes:
        sigma_min: Least singular value; 1 for the standard element in displacements.
        symmetric_min: Least eigenvalue of the symmetric part.
        is_negative: Whether the determinant's sign differs from that of the standard element.
        difference: Difference of the displacements under a uniform body force along the first axis,
            relative to the standard element's, in its energy norm.
    """

    sigma_min: float
    symmetric_min: float
    is_negative: bool
    difference: float


def condense_inner_nodes(
    K: Array, is_inner: npt.NDArray[np.bool_], f: Array | None = None
) -> tuple[Array, Array]:
    """Return stiffness and load of the other unknowns, with the equations of the inner ones kept."""
    kept = ~is_inner
    left = np.linalg.solve(K[np.ix_(is_inner, is_inner)].T, K[np.ix_(kept, is_inner)].T).T
    load = np.zeros(len(K)) if f is None else f
    matrix = K[np.ix_(kept, kept)] - left @ K[np.ix_(is_inner, kept)]
    return np.asarray(matrix), np.asarray(load[kept] - left @ load[is_inner])


def measure_displacements(mesh: MeshParameters, nus: Sequence[float]) -> list[Solvability]:
    """Measure the stiffness of displacements without a pressure, for each Poisson's ratio."""
    pw, standard = assemble(mesh, True), assemble(mesh, False)
    topology = topology_of(mesh.element)
    if mesh.element == "Q8":
        inner = _is_inner_node_of_q8(topology)[~topology.base]
        is_inner = np.repeat(inner, topology.lattice.shape[1])
        measures = []
        for nu in nus:
            (K, f), (K_G, f_G) = (
                condense_inner_nodes(part.stiffness(nu), is_inner, part.load)
                for part in (pw, standard)
            )
            L = np.linalg.cholesky(K_G)
            loads = np.linalg.solve(L, np.column_stack([f, f_G])).T
            measures.append(_measure_in_energy_norm(_scale(K, L), *loads))
        return measures
    # V^T shear V = I and V^T bulk V = diag(b) for the standard element
    L = np.linalg.cholesky(standard.shear)
    b, vectors = np.linalg.eigh(_scale(standard.bulk, L))
    V = np.linalg.solve(L.T, vectors)
    shear, bulk = V.T @ pw.shear @ V, V.T @ pw.bulk @ V
    f, f_G = pw.load @ V, standard.load @ V
    measures = []
    for nu in nus:
        lame = 2 * nu / (1 - 2 * nu)
        root = np.sqrt(1 + lame * np.maximum(b, 0))
        K = (shear + lame * bulk) / np.outer(root, root)
        measures.append(_measure_in_energy_norm(K, f / root, f_G / root))
    return measures


def _measure_in_energy_norm(K: Array, f: Array, u_G: Array) -> Solvability:
    """Measure a matrix that is scaled by the standard element's energy norm.

    Args:
        K: Stiffness (n, n); the standard one is the unit matrix.
        f: Load (n,).
        u_G: Standard element's displacements, or its load.
    """
    difference = np.linalg.norm(np.linalg.solve(K, f) - u_G) / np.linalg.norm(u_G)
    return Solvability(
        _least_singular_value(K),
        float(np.linalg.eigvalsh((K + K.T) / 2)[0]),
        bool(np.linalg.slogdet(K)[0] < 0),
        float(difference),
    )


def _least_singular_value(K: Array) -> float:
    return float(np.linalg.svd(K, compute_uv=False)[-1])


def measure_hybrid(mesh: MeshParameters, nus: Sequence[float]) -> list[Solvability]:
    """Measure the matrix of displacements and a pressure, for each Poisson's ratio.

    The norm of (u, p) is that of section V15: twice the shear energy, and p^2 / (2 mu). The least
    singular value is relative to the standard hybrid element's; `symmetric_min` is 0.
    """
    parts = assemble(mesh, True), assemble(mesh, False)
    L_u, L_p = np.linalg.cholesky(parts[1].shear), np.linalg.cholesky(parts[1].pressure / 2)
    n, m = len(L_u), len(L_p)
    L = np.block([[L_u, np.zeros((n, m))], [np.zeros((m, n)), L_p]])
    is_pressure = np.diag(np.arange(n + m) >= n)
    scaled = [
        _scale(np.block([[part.shear, -part.gradient], [-part.divergence, np.zeros((m, m))]]), L)
        for part in parts
    ]
    loads = [np.linalg.solve(L, np.append(part.load, np.zeros(m))) for part in parts]
    measures = []
    for nu in nus:
        compressibility = (1 - 2 * nu) / nu * is_pressure  # mu / lambda, over the norm's 1 / 2
        matrices = [matrix - compressibility for matrix in scaled]
        sigma = [_least_singular_value(matrix) for matrix in matrices]
        signs = [np.linalg.slogdet(matrix)[0] for matrix in matrices]
        new, standard = (
            np.linalg.solve(matrix, load) for matrix, load in zip(matrices, loads, strict=True)
        )
        difference = np.linalg.norm(new - standard) / np.linalg.norm(standard)
        measures.append(
            Solvability(sigma[0] / sigma[1], 0.0, bool(signs[0] != signs[1]), float(difference))
        )
    return measures


def _scale(K: Array, L: Array) -> Array:
    """Return L^-1 K L^-T."""
    return np.asarray(np.linalg.solve(L, np.linalg.solve(L, K).T).T)


# Map

SHIFTS: dict[Geometry, tuple[float, ...]] = {
    "affine": (0.3,),
    "straight": (0.1, 0.2, 0.3),
    "curved": (0.02, 0.05, 0.1),
}
STRETCHES: dict[str, tuple[Shape, tuple[int, ...]]] = {
    "compact": ("layers", (1,)),
    "layers": ("layers", (10, 100, 1000)),
    **{f"columns-{aspect_ratio}": ("columns", (aspect_ratio,)) for aspect_ratio in (10, 100)},
    **{f"needles-{aspect_ratio}": ("needles", (aspect_ratio,)) for aspect_ratio in (10, 100)},
}
"""Shapes and aspect ratios of the meshes of a group, by name of group."""
POISSONS_RATIOS = (0.3, 0.4, 0.45, 0.48, 0.49, 0.495, 0.498, 0.499, 0.4995, 0.4999, 0.49999)
POISSONS_RATIOS_OF_LONG_CELLS = (0.3,)
POISSONS_RATIOS_OF_HYBRID = (0.3, 0.5)
GROUPS_WITH_ALL_RATIOS = ("compact", "layers")
MESHES_PER_SHIFT = {2: {"compact": 40, "long": 10}, 3: {"compact": 15, "long": 4}}
"""Number of compact and of long meshes for each shift and aspect ratio, by dimension."""


def list_meshes(element: str, geometry: Geometry, group: str) -> list[MeshParameters]:
    """Return the meshes of a group; affine ones are as many as those with one shift."""
    shape, aspect_ratios = STRETCHES[group]
    dim = topology_of(element).lattice.shape[1]
    n_meshes = MESHES_PER_SHIFT[dim]["compact" if group == "compact" else "long"]
    return [
        MeshParameters(element, geometry, shape, float(aspect_ratio), shift, seed)
        for aspect_ratio in aspect_ratios
        for shift in SHIFTS[geometry]
        for seed in range(n_meshes)
    ]


def solvability_map(element: str, geometry: Geometry) -> Result:
    """Measure the matrices of many meshes of an element.

    Scalars are, by group of meshes and Poisson's ratio, the least `sigma_min` and `symmetric_min`
    of the stiffness of displacements, the number `negative` of meshes on which its determinant is
    negative, the place `worst` of the mesh with the least `sigma_min` in `list_meshes`, the largest
    `difference` of displacements, and for elements with a pressure the least ratio `hybrid` of singular values and the number
    `hybrid_negative` of determinants whose sign differs.

    Args:
        element: Name of the element, as "pw-T6".
        geometry: Geometry of the cells.
    """
    element = element.removeprefix("pw-")
    scalars: dict[str, float] = {"meshes": 0.0}
    for group in STRETCHES:
        meshes = list_meshes(element, geometry, group)
        scalars["meshes"] += len(meshes)
        nus = POISSONS_RATIOS if group in GROUPS_WITH_ALL_RATIOS else POISSONS_RATIOS_OF_LONG_CELLS
        by_mesh = [measure_displacements(mesh, nus) for mesh in meshes]
        for nu, measures in zip(nus, zip(*by_mesh, strict=True), strict=True):
            name = f"{group}_{nu:g}"
            sigma = [m.sigma_min for m in measures]
            scalars[f"sigma_min_{name}"] = min(sigma)
            scalars[f"worst_{name}"] = float(np.argmin(sigma))
            scalars[f"difference_{name}"] = max(m.difference for m in measures)
            scalars[f"symmetric_min_{name}"] = min(m.symmetric_min for m in measures)
            scalars[f"negative_{name}"] = float(sum(m.is_negative for m in measures))
        if element == "Q8":
            continue
        by_mesh = [measure_hybrid(mesh, POISSONS_RATIOS_OF_HYBRID) for mesh in meshes]
        for nu, measures in zip(POISSONS_RATIOS_OF_HYBRID, zip(*by_mesh, strict=True), strict=True):
            scalars[f"hybrid_{group}_{nu:g}"] = min(m.sigma_min for m in measures)
            scalars[f"hybrid_difference_{group}_{nu:g}"] = max(m.difference for m in measures)
            scalars[f"hybrid_negative_{group}_{nu:g}"] = float(sum(m.is_negative for m in measures))
    topology = topology_of(element)
    n_unknowns = int((~topology.base).sum()) * topology.lattice.shape[1]
    return Result(scalars, assign_unit_one_to_scalars(scalars), dofs=n_unknowns)


# Uniqueness of frictionless contact

POISSONS_RATIOS_OF_CONTACT = (0.3, 0.49, 0.499, 0.4999)
MESHES_PER_SHIFT_IN_CONTACT = {2: 30, 3: 10}
RANDOM_SETS_IN_SPACE = 500
"""Number of sets of closed nodes that are drawn where there are too many to try all."""


def contact_stiffness(mesh: MeshParameters, nu: float, has_new_weights: bool = True) -> Array:
    """Return the matrix (m, m) of contact forces by the closing motions of contact nodes.

    All nodes of the face opposite the clamped base may touch a smooth rigid plane that is parallel
    to the base; the matrix is the Schur complement of the stiffness on their normal displacements,
    for the shear modulus 1. Nodes are in the order of the lattice.
    """
    parts, topology = assemble(mesh, has_new_weights), topology_of(mesh.element)
    K = parts.stiffness(nu)
    heights = topology.lattice[~topology.base, -1]
    is_contact = np.zeros((len(heights), topology.lattice.shape[1]), dtype=bool)
    is_contact[heights == heights.max(), -1] = True
    return condense_inner_nodes(K, ~is_contact.ravel())[0]


def closed_sets(n_nodes: int, seed: int) -> npt.NDArray[np.bool_]:
    """Return masks (s, n) of sets of closed nodes: all of them, or random ones if n > 10."""
    if n_nodes <= 10:
        return np.array(list(product((False, True), repeat=n_nodes))[1:])
    rng = np.random.default_rng(seed)
    return rng.uniform(size=(RANDOM_SETS_IN_SPACE, n_nodes)) < rng.uniform(
        0.05, 1, (RANDOM_SETS_IN_SPACE, 1)
    )


def principal_minor_signs(S: Array, sets: npt.NDArray[np.bool_]) -> Array:
    """Return the signs (s,) of the principal minors of a matrix for masks (s, n)."""
    minors = np.where(sets[:, :, None] & sets[:, None, :], S, np.eye(len(S)))
    return np.asarray(np.linalg.slogdet(minors)[0])


def contact_uniqueness(element: str, geometry: Geometry) -> Result:
    """Count the negative principal minors of contact stiffness matrices on compact meshes.

    Frictionless contact has exactly one solution for any load and any gaps if and only if all
    principal minors are positive (the matrix is a P-matrix).

    Args:
        element: Name of the element, as "pw-T6".
        geometry: Geometry of the cells.
    """
    element = element.removeprefix("pw-")
    scalars = dict.fromkeys(("meshes", "minors"), 0.0)
    scalars |= {
        f"{name}_{nu:g}": 0.0
        for nu in POISSONS_RATIOS_OF_CONTACT
        for name in ("negative", "meshes_negative")
    }
    largest_reaction = 0.0
    n_meshes = MESHES_PER_SHIFT_IN_CONTACT[topology_of(element).lattice.shape[1]]
    for shift, seed in product(SHIFTS[geometry], range(n_meshes)):
        mesh = MeshParameters(element, geometry, "layers", 1.0, shift, seed)
        scalars["meshes"] += 1
        for nu in POISSONS_RATIOS_OF_CONTACT:
            S = contact_stiffness(mesh, nu)
            sets = closed_sets(len(S), seed)
            n_negative = int((principal_minor_signs(S, sets) < 0).sum())
            scalars[f"negative_{nu:g}"] += n_negative
            scalars[f"meshes_negative_{nu:g}"] += n_negative > 0
            if element == "T6" and geometry != "curved":
                largest_reaction = max(largest_reaction, reaction_of_open_middles(mesh, nu, sets))
        scalars["minors"] += len(sets)
    if largest_reaction:
        scalars["reaction"] = largest_reaction
    return Result(scalars, assign_unit_one_to_scalars(scalars), dofs=len(S))


def reaction_of_open_middles(mesh: MeshParameters, nu: float, sets: npt.NDArray[np.bool_]) -> float:
    """Return the largest sum of reactions that bounds the minors of straight T6 (see the page).

    A unit force acts on a node of a set, whose nodes can move while all other contact nodes are
    held, with the standard element. The absolute reactions at held mid-side nodes are added.
    """
    S = contact_stiffness(mesh, nu, has_new_weights=False)
    is_middle = np.arange(len(S)) % 2 == 1
    return max(
        float(
            np.abs(S[np.ix_(held, moving)] @ np.linalg.inv(S[np.ix_(moving, moving)])).sum(0).max()
        )
        for moving in sets
        if (held := is_middle & ~moving).any()
    )


def two_solutions(S: Array, sets: npt.NDArray[np.bool_]) -> tuple[Array, Array, Array, Array]:
    """Return two solutions of a frictionless contact problem whose matrix has a negative minor.

    The matrix of the smallest such set has a real negative eigenvalue, S x = -|w| x. Then the
    gaps x+ and x-, and the forces (S x)+ and (S x)-, the positive and the negative parts, solve
    force = S gap + q with the same q.

    Returns:
        Gaps and forces (m,) of the first solution, gaps and forces of the second.

    Raises:
        ValueError: If no minor is negative.
    """
    negative = sets[principal_minor_signs(S, sets) < 0]
    if not len(negative):
        raise ValueError("no principal minor of these sets is negative")
    smallest = negative[negative.sum(axis=1).argmin()]
    values, vectors = np.linalg.eig(S[np.ix_(smallest, smallest)])
    is_real = np.abs(values.imag) <= 1e-9 * np.abs(values).max()
    column = np.where(is_real, values.real, np.inf).argmin()
    x = np.zeros(len(S))
    x[smallest] = vectors[:, column].real
    force = np.where(smallest, values[column].real * x, S @ x)
    return np.maximum(x, 0), np.maximum(force, 0), np.maximum(-x, 0), np.maximum(-force, 0)


def ambiguous_contact(
    element: str, geometry: Geometry, nu: float, shift: float, seed: int
) -> Result:
    """Construct a frictionless contact problem with two solutions.

    Scalars are the number of closed nodes in each solution, and the largest violation of
    force = S gap + q, relative to the largest force. Curves are the mesh (`nodes` of cells), the
    loads q, and gaps and forces of both solutions at the nodes of the face that may touch.

    Args:
        element: Name of the element, as "pw-T6".
        geometry: Geometry of the cells.
        nu: Poisson's ratio.
        shift: Largest shift of nodes.
        seed: Seed of the mesh.
    """
    mesh = MeshParameters(element.removeprefix("pw-"), geometry, "layers", 1.0, shift, seed)
    S = contact_stiffness(mesh, nu)
    gap_1, force_1, gap_2, force_2 = two_solutions(S, closed_sets(len(S), seed))
    q = force_1 - S @ gap_1
    residual = np.abs(force_2 - S @ gap_2 - q).max() / max(force_1.max(), force_2.max())
    curves = {"nodes": make_cell_nodes(mesh), "q": q, "gap_1": gap_1, "force_1": force_1}
    curves |= {"gap_2": gap_2, "force_2": force_2}
    scalars = {
        "closed_1": float((gap_1 == 0).sum()),
        "closed_2": float((gap_2 == 0).sum()),
        "contact_nodes": float(len(S)),
        "residual": float(residual),
    }
    return Result(scalars, assign_unit_one_to_scalars(scalars), curves)


def node_positions(mesh: MeshParameters) -> Array:
    """Return the positions (n, dim) of the nodes of a distorted mesh, in the lattice's order."""
    topology = topology_of(mesh.element)
    x = np.zeros(topology.lattice.shape)
    x[topology.cells.ravel()] = make_cell_nodes(mesh).reshape(-1, x.shape[1])
    return x


def make_mesh(mesh: MeshParameters) -> Mesh:
    """Return a distorted mesh for DOLFINx; its geometry has degree 2 if cells are curved."""
    topology, cell = topology_of(mesh.element), CELL_BY_ELEMENT[mesh.element]
    cells, dim, x = topology.cells, topology.lattice.shape[1], node_positions(mesh)
    if mesh.geometry != "curved":
        cells = cells[:, : topology.corner_weights.shape[1]]
        used, cells = np.unique(cells, return_inverse=True)
        x, cells = x[used], cells.reshape(-1, topology.corner_weights.shape[1])
    degree = 2 if mesh.geometry == "curved" else 1
    geometry = basix.ufl.element("Lagrange", cell, degree, shape=(dim,))
    return create_mesh(MPI.COMM_SELF, cells=cells.astype(np.int64), x=x, e=geometry)


# Mass


def mass_pairs(element: str) -> Result:
    """Compute the eigenvalues of pairs of stiffness and mass on a distorted, clamped mesh.

    Pairs are the new stiffness with the lumped (row-sum) mass, the same with the mass T M of the
    force transfer T and the lumped mass M, and the stiffness T K T^T of the symmetric sibling with
    the lumped mass. Scalars are, for each, the largest imaginary part of an eigenvalue, relative to
    the largest modulus, the number of complex eigenvalues and the least real part.

    Args:
        element: "pw-T6" or "pw-T10".
    """
    mesh = make_mesh(MeshParameters(element.removeprefix("pw-"), "straight", "layers", 1.0, 0.2, 0))
    dim = mesh.geometry.dim
    material = Material(1.0, 0.3)
    state = StressState.PLANE_STRESS if dim == 2 else StressState.SOLID
    pw = Body(Spaces.petrov_galerkin(mesh), material, state)
    galerkin = Body(Spaces.galerkin(mesh), material, state)
    space = galerkin.spaces.trial
    clamp = Reduction.dirichlet(
        space, [prescribe(space, i, lambda x: np.isclose(x[dim - 1], 0.0)) for i in range(dim)]
    )
    K_galerkin = assemble_matrix(galerkin.stiffness())
    lumped = lumped_mass(assemble_matrix(pw.mass()), pw.spaces.trial)
    K = to_dense_array(clamp.matrix(assemble_matrix(pw.stiffness())))
    K_sibling = to_dense_array(clamp.matrix(Sibling.from_space(space).matrix(K_galerkin)))
    M = to_dense_array(clamp.matrix(lumped))
    T = to_dense_array(clamp.matrix(force_transfer(space)))
    scalars: dict[str, float] = {}
    for name, stiffness, mass in (
        ("lumped", K, M),
        ("transferred", K, T @ M),
        ("sibling", K_sibling, M),
    ):
        eigenvalues = scipy.linalg.eigvals(stiffness, mass)
        largest = np.abs(eigenvalues).max()
        scalars |= {
            f"imaginary_{name}": float(np.abs(eigenvalues.imag).max() / largest),
            f"complex_{name}": float((np.abs(eigenvalues.imag) > 1e-10 * largest).sum()),
            f"least_real_{name}": float(eigenvalues.real.min()),
        }
    return Result(scalars, assign_unit_one_to_scalars(scalars), dofs=len(K))
