"""Writes fields of contact problems that must not depend on the number of processes.

Started by test_contact_fields.py with `mpirun`: `FOLDER` has a state of two blocks from one
process, and gets files of fields.
"""

import sys
from pathlib import Path

from mpi4py import MPI

import numpy as np
from dolfinx.mesh import CellType, create_box

from pw_elements import Body, Material, Reduction, Spaces, assemble_matrix, prescribe, reactions
from pw_elements.contact import ContactFields, ContactPair, Motion, Sphere, solve_contact, write
from pw_elements.elasticity import StressState
from tests.contact.cases import Block, at
from tests.contact.test_matching import Blocks
from tests.contact.two_bodies import Stack


def blocks_apart(comm):
    """Two blocks, pressed together; problem and load."""
    blocks = Blocks(comm=comm)
    return blocks, blocks.problem(blocks.pair()), blocks.load((0.0, -3.0))


def unbalanced(blocks, state, load):
    """Largest difference of the contact forces from what the body's equations leave over."""
    fields = ContactFields.of(state, blocks.space)
    left = reactions(blocks.K, state.displacement, load).array_r
    owned = fields.force.x.array[: len(left)].reshape(-1, 2)
    x = blocks.space.tabulate_dof_coordinates()[: len(owned)]
    held = np.isclose(x[:, 1], 0.0) | np.isclose(x[:, 0], 0.0)
    return np.abs(left.reshape(-1, 2) - owned)[~held].max(initial=0.0), np.abs(owned).max(initial=0)


def ball(cell, method, comm=MPI.COMM_SELF):
    """A sphere pressed on the top of a block and pushed sideways."""
    mesh = create_box(comm, [(-1, -1, 0), (1, 1, 1)], (6, 6, 2), cell)
    body = Body(method(mesh), Material(1000.0, 0.3), StressState.SOLID)
    U = body.spaces.trial
    K = assemble_matrix(body.stiffness())
    foot = Reduction.dirichlet(U, [prescribe(U, i, at(2, 0.0)) for i in range(3)])
    motions = [Motion((0, 0, -0.1)), Motion((0.01, 0.02, None), (0, 0, -80.0))]
    pair = ContactPair(at(2, 1.0), Sphere((0, 0, 3), 2.0), 0.3, motions)
    return body, K, solve_contact(K, [K.createVecLeft()] * 2, foot, [pair], U)


def two_bodies(comm, cell, divisions):
    """A block pressed and pushed on a wider one, on meshes that do not match; body and state."""
    stack = Stack(divisions, cell, upper=(0.13, 0.83), comm=comm)
    held = [prescribe(stack.space, i, at(stack.up, 0.0)) for i in range(stack.dim)]
    moved = [0.01] * stack.up + [-0.02]
    held += [prescribe(stack.space, i, at(stack.up, 2.0), moved[i]) for i in range(stack.dim)]
    supports, load = Reduction.dirichlet(stack.space, held), stack.K.createVecLeft()
    pair = stack.pair("lower", 0.2)
    return stack.body, solve_contact(stack.K, load, supports, pair, stack.space)


if __name__ == "__main__":
    comm, folder = MPI.COMM_WORLD, Path(sys.argv[1])
    block = Block(12, comm=comm)
    states = block.solve(0.3, 60.0, increments=2)
    write(folder / "block.bp", states, block.body)
    body, _, states = ball(CellType.tetrahedron, Spaces.petrov_galerkin, comm)
    write(folder / "ball.bp", states, body)
    blocks, problem, load = blocks_apart(comm)
    state = problem.load(folder / "serial.npz")
    wrong, force = unbalanced(blocks, state, load)
    assert comm.allreduce(wrong, MPI.MAX) < 1e-9 * comm.allreduce(force, MPI.MAX)
    write(folder / "blocks.bp", state, blocks.body, times=[2.5])
    for cell, divisions in (("triangle", (5, 4)), ("tetrahedron", (3, 2))):
        body, states = two_bodies(comm, cell, divisions)
        write(folder / f"{cell}.bp", states, body)
