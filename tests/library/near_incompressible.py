"""Map of the least singular values of displacement elements near incompressibility.

    ./run python3 -m tests.library.near_incompressible [--samples 4] [--cells tetrahedron ...]

prints a line for each type of cell and each distortion. For each Poisson's ratio, the line has the
least singular value, over all meshes, of the matrix

    L^-1 K L^-T,    K_G = L L^T,

and the number of meshes on which det K is negative. Here, K is the stiffness with piecewise-linear
weights, and K_G is the standard element's stiffness on the same mesh. The singular value is 1 for
the standard element itself and 0 for a singular K. The square or cube is clamped at its base.
Vertices, or mid-side nodes on curved meshes, are moved at random by up to a fraction of the cell
size. The map is coarse: it covers a few meshes with 2 to 4 cells per side. The results and the
limits derived from them are in docs/solvability.md.
"""

import argparse
from collections.abc import Sequence
from typing import NamedTuple

from mpi4py import MPI

import numpy as np
import numpy.typing as npt
import scipy.linalg
from dolfinx.mesh import CellType, Mesh, create_box, create_rectangle

from pw_elements import Body, Material, Reduction, Spaces, assemble_matrix, prescribe
from pw_elements.meshes import curved_mesh
from study.model.matrices import to_dense_array

DEFAULT_POISSONS_RATIOS = (0.45, 0.48, 0.49, 0.495, 0.499, 0.4995, 0.4999, 0.49999)
CELLS_PER_SIDE_BY_CELL = {"triangle": 4, "quadrilateral": 4, "tetrahedron": 2, "hexahedron": 2}
# Random shifts of vertices, or of mid-side nodes on curved meshes, relative to the size of cells
SHIFTS_OVER_CELL_SIZE_BY_MOVES_MID_NODES = {False: (0.0, 0.1, 0.2), True: (0.02, 0.05)}


class SingularityMeasures(NamedTuple):
    """Measures of how close K is to a singular matrix, for a mesh and a Poisson's ratio.

    The module defines K and L.
    """

    least: float  # least singular value of L^-1 K L^-T
    sign: int  # sign of the determinant of K
    energy: float  # least eigenvalue of the symmetric part of L^-1 K L^-T


def make_distorted_mesh(
    cell: str, cells_per_side: int, relative_shift: float, seed: int, moves_mid_nodes: bool = False
) -> Mesh:
    """Create a unit square or cube whose vertices or mid-side nodes are moved at random.

    Shifts are at most `relative_shift` times the cell size in each direction.
    """
    dim = 2 if cell in ("triangle", "quadrilateral") else 3
    build, ends = (create_rectangle if dim == 2 else create_box), [(0.0,) * dim, (1.0,) * dim]
    mesh = build(MPI.COMM_SELF, ends, [cells_per_side] * dim, CellType[cell])
    rng = np.random.default_rng(seed)

    def random_node_shifts(x: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Return random shifts (n, 3), either of vertices or of all other nodes.

        Nodes in the base stay in its plane.
        """
        shift = np.zeros_like(x)
        shift[:, :dim] = rng.uniform(-1, 1, (len(x), dim)) * relative_shift / cells_per_side
        vertex = np.isclose(x * cells_per_side, np.round(x * cells_per_side)).all(axis=1)
        shift[vertex if moves_mid_nodes else ~vertex] = 0.0
        shift[np.isclose(x[:, dim - 1], 0.0), dim - 1] = 0.0
        return shift

    if moves_mid_nodes:
        return curved_mesh(mesh, lambda x: x + random_node_shifts(x))
    mesh.geometry.x[:] += random_node_shifts(mesh.geometry.x)
    return mesh


def assemble_lame_stiffness_parts(
    spaces: Spaces, quadrature_degree: int | None
) -> list[npt.NDArray[np.float64]]:
    """Assemble the dense matrices A and B of the stiffness mu A + lambda B, with clamped base.

    Here, mu and lambda are Lame's constants.
    """
    mesh = spaces.mesh
    dim = mesh.geometry.dim
    state = "plane strain" if dim == 2 else "solid"
    base = [prescribe(spaces.trial, k, lambda x: np.isclose(x[dim - 1], 0.0)) for k in range(dim)]
    reduction = Reduction.dirichlet(spaces.trial, base)
    matrices = []
    for nu in (0.0, 0.25):  # for these ratios lambda = 0 and mu = 1/2, or lambda = mu = 2/5
        body = Body(spaces, Material(1.0, nu), state, quadrature_degree=quadrature_degree)
        matrices.append(to_dense_array(reduction.matrix(assemble_matrix(body.stiffness()))))
    A = 2 * matrices[0]
    return [A, matrices[1] / 0.4 - A]


def measure_singularity(
    mesh: Mesh, poissons_ratios: Sequence[float], quadrature_degree: int | None = None
) -> list[SingularityMeasures]:
    """Return the measures of singularity on a mesh, one for each Poisson's ratio."""
    pw, standard = (
        assemble_lame_stiffness_parts(make(mesh), quadrature_degree)
        for make in (Spaces.petrov_galerkin, Spaces.galerkin)
    )
    result = []
    for nu in poissons_ratios:
        lame = 2 * nu / (1 - 2 * nu)  # lambda divided by mu
        K, K_G = (A + lame * B for A, B in (pw, standard))
        L = np.linalg.cholesky((K_G + K_G.T) / 2)
        half = scipy.linalg.solve_triangular(L, K, lower=True)
        scaled = scipy.linalg.solve_triangular(L, half.T, lower=True).T
        least = scipy.linalg.svdvals(scaled)[-1]
        energy = scipy.linalg.eigvalsh((scaled + scaled.T) / 2, subset_by_index=[0, 0])[0]
        result.append(
            SingularityMeasures(float(least), int(np.linalg.slogdet(scaled)[0]), float(energy))
        )
    return result


def print_least_singular_value_map() -> None:
    """Print the map that the module describes as a table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--samples", type=int, default=4)
    parser.add_argument(
        "--cells",
        nargs="+",
        default=list(CELLS_PER_SIDE_BY_CELL),
        choices=list(CELLS_PER_SIDE_BY_CELL),
    )
    parser.add_argument("--degree", type=int, default=None)
    parser.add_argument("--ratios", type=float, nargs="+", default=DEFAULT_POISSONS_RATIOS)
    options = parser.parse_args()
    print("least singular value over all meshes (meshes with det K < 0), over nu:")
    print(f"{'':32s}" + "".join(f"{nu:>13g}" for nu in options.ratios))
    for cell in options.cells:
        for mid_nodes in (False, True):
            for distortion in SHIFTS_OVER_CELL_SIZE_BY_MOVES_MID_NODES[mid_nodes]:
                n = CELLS_PER_SIDE_BY_CELL[cell]
                ratios_of_meshes = [
                    measure_singularity(
                        make_distorted_mesh(cell, n, distortion, seed, mid_nodes),
                        options.ratios,
                        options.degree,
                    )
                    for seed in range(options.samples if distortion else 1)
                ]
                row = [
                    f"{min(s.least for s in at):9.4f} ({sum(s.sign < 0 for s in at)})"
                    for at in zip(*ratios_of_meshes, strict=True)
                ]
                name = f"{cell} {n}, {'mid nodes' if mid_nodes else 'vertices'} {distortion:g} h"
                print(f"{name:32s}" + "".join(f"{cell_text:>13s}" for cell_text in row), flush=True)


if __name__ == "__main__":
    print_least_singular_value_map()
