"""Two layers, nearly incompressible and compressible, pressed evenly between smooth walls.

Strains are constant in each layer, and so is the pressure, which jumps between them: elements whose
pressure is split there are exact, those with one pressure are not.
"""

from collections.abc import Callable

from mpi4py import MPI

import numpy as np
import numpy.typing as npt
from dolfinx import fem
from dolfinx.mesh import (
    CellType,
    Mesh,
    MeshTags,
    compute_midpoints,
    create_unit_cube,
    create_unit_square,
    meshtags,
)

from pw_elements import (
    Body,
    Material,
    Reduction,
    Spaces,
    assemble_matrix,
    assemble_vector,
    boundary_measure,
    prescribe,
    solve,
    split,
)
from pw_elements.elasticity import StressState
from pw_elements.meshes import move_nodes
from study.meshes.distorted_meshes import CELLS
from study.model.elements import taylor_hood
from study.model.units import dimensionless
from study.run.store import Result

Array = npt.NDArray[np.float64]

N = 4  # cells a side
# Of the lower and the upper layer
MODULI, RATIOS = np.array([2.0, 20.0]), np.array([0.4999, 0.3])


def layers(element: str) -> Result:
    """Largest error of a displacement over the largest displacement.

    `error` with a pressure that is split between the layers, `error_one` with one that is not.
    """
    method = Spaces.hybrid if element.startswith("pw") else taylor_hood
    mesh = layered(MPI.COMM_SELF, CELLS[element.rsplit("-", 1)[1]])
    scalars = {name: error(method, mesh, name == "error") for name in ("error", "error_one")}
    space = method(mesh, None).trial.dofmap
    dofs = space.index_map.size_global * space.index_map_bs
    return Result(scalars, dimensionless(scalars), {}, dofs=dofs)


def layered(comm: MPI.Comm, cell: CellType) -> Mesh:
    """Unit square or cube whose nodes inside are moved, but for those between the layers."""
    if cell in (CellType.triangle, CellType.quadrilateral):
        return move_nodes(create_unit_square(comm, N, N, cell), _moved)
    return move_nodes(create_unit_cube(comm, N, N, N, cell), _moved)


def error(
    method: Callable[[Mesh, MeshTags | None], Spaces], mesh: Mesh, split_pressure: bool
) -> float:
    """Of the displacements of a pair of spaces."""
    dim = mesh.geometry.dim
    up = dim - 1
    count = mesh.topology.index_map(dim)
    cells = np.arange(count.size_local + count.num_ghosts, dtype=np.int32)
    layer = (compute_midpoints(mesh, dim, cells)[:, up] > 0.5).astype(np.int32)
    E, nu = (fem.Function(fem.functionspace(mesh, ("DG", 0))) for _ in range(2))
    E.x.array[:], nu.x.array[:] = MODULI[layer], RATIOS[layer]
    spaces = method(mesh, meshtags(mesh, dim, cells, layer) if split_pressure else None)
    state = StressState.PLANE_STRAIN if dim == 2 else StressState.SOLID
    body = Body(spaces, Material(E, nu), state)

    def side(axis: int, end: float) -> Callable[[Array], npt.NDArray[np.bool_]]:
        return lambda x: np.isclose(x[axis], end)

    W = spaces.trial
    walls = [prescribe(W, k, side(k, end)) for k in range(up) for end in (0.0, 1.0)]
    held = Reduction.dirichlet(spaces, [*walls, prescribe(W, up, side(up, 0.0))])
    push = np.zeros(dim)
    push[up] = -1.0
    f = assemble_vector(body.surface_load(push, boundary_measure(mesh, side(up, 1.0))))
    u, _ = split(W, solve(assemble_matrix(body.stiffness()), f, held))
    strain = (1 + RATIOS) * (1 - 2 * RATIOS) / ((1 - RATIOS) * MODULI)
    z = u.function_space.tabulate_dof_coordinates()[:, up]
    exact = np.zeros((len(z), dim))
    exact[:, up] = -np.minimum(z, 0.5) * strain[0] - np.maximum(z - 0.5, 0.0) * strain[1]
    off = np.abs(u.x.array.reshape(-1, dim) - exact).max(initial=0.0)
    largest = mesh.comm.allreduce(np.abs(exact).max(initial=0.0), MPI.MAX)
    return float(mesh.comm.allreduce(off, MPI.MAX) / largest)


def _moved(x: Array) -> Array:
    """Smooth map (n, 3) of the unit square or cube to itself that keeps the plane between."""
    dim = 3 if x[:, 2].any() else 2
    x_moved = x[:, :dim]
    waves = np.array([1.0, 1.0, 2.0])[-dim:]  # none of the last coordinate between
    bubble = np.prod(np.sin(np.pi * waves * x_moved), axis=1, keepdims=True)
    moved = x.copy()
    moved[:, :dim] += 0.06 * bubble * np.cos(2 * x_moved + np.arange(dim))
    return moved
