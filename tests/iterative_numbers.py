"""Prints numbers of the iterative solver that must not depend on the number of processes."""

import json

from mpi4py import MPI

import numpy as np
from dolfinx.mesh import CellType, create_box

from pw_elements import (
    Body,
    Iterative,
    Material,
    Reduction,
    SingularSystem,
    Spaces,
    assemble_matrix,
    assemble_vector,
    prescribe,
    solve,
    vibration_modes,
)

comm = MPI.COMM_WORLD
numbers: dict[str, list[float] | float | str] = {}


def solid(cell):
    mesh = create_box(comm, [(0, 0, 0), (2, 1, 1)], (6, 3, 3), CellType[cell])
    body = Body(Spaces.petrov_galerkin(mesh), Material(1.0, 0.3), "solid")
    U = body.spaces.trial
    K = assemble_matrix(body.stiffness())
    f = assemble_vector(body.body_load((0.0, 0.3, -1.0)))
    foot = [prescribe(U, i, lambda x: np.isclose(x[0], 0.0), 0.1 * i) for i in range(3)]
    held = Reduction.dirichlet(U, foot)
    numbers[f"{cell}_displacement_norm"] = solve(K, f, held, Iterative()).norm()
    modes = vibration_modes(K, assemble_matrix(body.mass()), held, 3, solver=Iterative())
    numbers[f"{cell}_frequencies"] = modes.eigenvalues.tolist()
    try:
        solve(K, f, Reduction.dirichlet(U, foot[:2]), Iterative())
    except SingularSystem:
        numbers[f"{cell}_free"] = 1.0


solid("tetrahedron")
solid("hexahedron")
if comm.rank == 0:
    print(json.dumps(numbers))
