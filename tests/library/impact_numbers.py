"""Prints results of explicit dynamics that must not depend on the number of processes, as JSON.

Started by test_parallel.py with `mpirun -n 1` and more.
"""

import json

from mpi4py import MPI

import numpy as np
from dolfinx.mesh import CellType, create_box

from pw_elements import (
    Body,
    Material,
    Sibling,
    Spaces,
    assemble_matrix,
    assemble_vector,
    lumped_mass,
    prescribe,
    solve,
)
from pw_elements.contact import ContactPair, Plane, Sphere, solve_contact, solve_impact
from pw_elements.elasticity import StressState
from tests.contact.cases import at

comm = MPI.COMM_WORLD
numbers = {}
mesh = create_box(comm, [(0, 0, 0), (2, 1, 1)], (6, 3, 3), CellType.tetrahedron)
body = Body(Spaces.galerkin(mesh), Material(10.0, 0.3), StressState.SOLID)
U = body.spaces.trial
sibling = Sibling.of(U)
K = sibling.matrix(assemble_matrix(body.stiffness()))
M = lumped_mass(sibling.matrix(assemble_matrix(body.mass())), U)
weight = sibling.load(assemble_vector(body.body_load((0.0, 0.0, -0.5))))

thrown = K.createVecRight()
thrown.array.reshape(-1, 3)[:] = (0.5, 0.1, -1.0)
floor = ContactPair(at(2, 0.0), Plane((0, 0, 0), (0, 0, 1)), 0.3)
ball = ContactPair(at(2, 1.0), Sphere((1, 0.5, 4), 2.9), 0.2)
free = sibling.dirichlet([])
history = solve_impact(
    K,
    M,
    free,
    [floor, ball],
    U,
    1.5,
    thrown,
    load=lambda time: weight * (1 + time),
    paths=[None, lambda time: (0.2 * time, 0.0, -0.4 * time)],
    step=0.025,
    frames=2,
)
cut = [
    len(part) for part in comm.allgather(np.flatnonzero(at(2, 0.0)(U.tabulate_dof_coordinates().T)))
]
assert comm.size == 1 or sum(count > 0 for count in cut) > 1, "the partition spares the contact"
numbers["critical_step"] = history.critical_step
numbers["energy"] = np.array(list(vars(history.energies).values()))
numbers["displacement"] = history.displacement.norm()
numbers["velocity"] = history.velocity.norm()
for k, pair in enumerate(history.pairs):
    numbers[f"force {k}"] = pair.force
    for n, frame in enumerate(history.frames):
        for field in ("force_normal", "force_tangential", "status", "gap", "slip", "displacement"):
            numbers[f"frame {n} {k} {field}"] = getattr(frame.pairs[k], field)

# the sibling at rest: supports with values, contact on its gaps
foot = sibling.dirichlet([prescribe(U, i, at(2, 0.0), 0.02 * i) for i in range(3)])
near = ContactPair(at(2, 1.0), Sphere((1, 0.5, 3.91), 2.9), 0.2)
numbers["held"] = sibling.displacement(solve(K, weight, foot)).norm()
(state,) = solve_contact(K, weight, foot, near, U)
numbers["static force"], numbers["static gap"] = state.pairs[0].force_normal, state.pairs[0].gap
if comm.rank == 0:
    print(json.dumps({name: np.asarray(value).tolist() for name, value in numbers.items()}))
