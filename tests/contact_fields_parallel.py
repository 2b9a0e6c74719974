"""Writes fields of contact problems that must not depend on the number of processes.

Started by test_contact_fields.py with `mpirun`: `FOLDER` has a state of two blocks from one
process, and gets files of fields.
"""

import pickle
import sys
from pathlib import Path

from mpi4py import MPI

import numpy as np

from pw_elements import reactions
from pw_elements.contact import ContactFields, write
from tests.contact_cases import Block
from tests.test_contact_matching import Blocks


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


if __name__ == "__main__":
    comm, folder = MPI.COMM_WORLD, Path(sys.argv[1])
    block = Block(12, comm=comm)
    states = block.solve(0.3, 60.0, increments=2)
    states[1] = pickle.loads(pickle.dumps(states[1]))
    write(folder / "block.bp", states, block.body)
    blocks, problem, load = blocks_apart(comm)
    state = problem.load(folder / "serial.npz")
    wrong, force = unbalanced(blocks, state, load)
    assert comm.allreduce(wrong, MPI.MAX) < 1e-9 * comm.allreduce(force, MPI.MAX)
    write(folder / "blocks.bp", state, blocks.body, times=[2.5])
