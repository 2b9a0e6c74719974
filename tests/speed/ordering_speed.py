"""Compare MUMPS' orderings for stiffness matrices of quadratic elements in the plane and in space.

    ./run python3 -m tests.speed.ordering_speed [--runs 3]

The command prints the CPU times of the first factorisation, which includes the analysis, and of a
further one with the same pattern, by LU for the new element and by LDL^T for the standard one, with
approximate minimum degree, approximate minimum fill and MUMPS' own choice. Each run measures all
orderings in turn. `Direct` takes the first one for matrices with few entries per row and few rows.
If MUMPS was built without METIS and SCOTCH (Debian), it takes its own choice without a message
where an option asks for one of them: the last column has the number (INFOG(7)) of the ordering that
its own choice was, such as 4 for PORD.
"""

import argparse
import statistics
import time

from mpi4py import MPI
from petsc4py import PETSc

from dolfinx.mesh import CellType, Mesh, create_box, create_rectangle

from pw_elements import Body, Material, Reduction, Spaces, assemble_matrix, prescribe

ORDERINGS_BY_NAME = {"minimum degree": 0, "minimum fill": 2, "MUMPS' choice": 7}
PLANE_DIVISIONS = (40, 80, 158)
SOLID_DIVISIONS = (6, 10, 14)


def make_meshes() -> list[tuple[str, Mesh]]:
    """Return names and meshes of T6, Q9 and T10."""
    plane = [
        (name, create_rectangle(MPI.COMM_SELF, [[0, 0], [2, 1]], [2 * n, n], cell))
        for name, cell in (("T6", CellType.triangle), ("Q9", CellType.quadrilateral))
        for n in PLANE_DIVISIONS
    ]
    solid = [
        ("T10", create_box(MPI.COMM_SELF, [[0, 0, 0], [1, 1, 1]], [n] * 3, CellType.tetrahedron))
        for n in SOLID_DIVISIONS
    ]
    return plane + solid


def assemble_supported_stiffness(mesh: Mesh, is_new: bool) -> PETSc.Mat:
    """Return the stiffness of a body whose left side is held."""
    spaces = Spaces.petrov_galerkin(mesh) if is_new else Spaces.galerkin(mesh)
    state = "plane strain" if mesh.geometry.dim == 2 else "solid"
    body = Body(spaces, Material(1.0, 0.3), state)
    conditions = [
        prescribe(spaces.trial, axis, lambda x: x[0] < 1e-9) for axis in range(mesh.geometry.dim)
    ]
    return Reduction.dirichlet(spaces.trial, conditions).matrix(assemble_matrix(body.stiffness()))


def factorise_twice(
    matrix: PETSc.Mat, is_symmetric: bool, ordering: int
) -> tuple[float, float, int]:
    """Return the CPU times of both factorisations in seconds, and the ordering that MUMPS used."""
    ksp = PETSc.KSP().create(matrix.comm)
    ksp.setOperators(matrix)
    ksp.setType("preonly")
    preconditioner = ksp.getPC()
    if is_symmetric:
        matrix.setOption(PETSc.Mat.Option.SYMMETRIC, True)
    preconditioner.setType("cholesky" if is_symmetric else "lu")
    preconditioner.setFactorSolverType("mumps")
    preconditioner.setFactorSetUpSolverType()
    factor = preconditioner.getFactorMatrix()
    factor.setMumpsIcntl(7, ordering)
    times = [time.process_time()]
    for _ in range(2):
        matrix.setValue(0, 0, matrix.getValue(0, 0))  # counts as a change of values
        matrix.assemble()
        ksp.setOperators(matrix)
        ksp.setUp()
        times.append(time.process_time())
    used_ordering = factor.getMumpsInfog(7)
    ksp.destroy()
    return times[1] - times[0], times[2] - times[1], used_ordering


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--runs", type=int, default=3)
    runs = parser.parse_args().runs
    print("cell  unknowns  entries/row  factors ", *(f"{name:>14}" for name in ORDERINGS_BY_NAME))
    for cell, mesh in make_meshes():
        for is_new in (False, True):
            matrix = assemble_supported_stiffness(mesh, is_new)
            seconds: dict[int, list[tuple[float, float]]] = {}
            for _ in range(runs):
                for ordering in ORDERINGS_BY_NAME.values():
                    *both, used_ordering = factorise_twice(matrix, not is_new, ordering)
                    seconds.setdefault(ordering, []).append((both[0], both[1]))
            n = matrix.getSize()[0]
            entries_per_row = matrix.getInfo()["nz_used"] / n
            medians = (
                " + ".join(
                    f"{statistics.median(times):.3f}" for times in zip(*runs_of_one, strict=True)
                )
                for runs_of_one in seconds.values()
            )
            kind = "LU    " if is_new else "LDL^T "
            print(f"{cell:4} {n:9} {entries_per_row:12.1f}  {kind}  ", *medians, used_ordering)


if __name__ == "__main__":
    main()
