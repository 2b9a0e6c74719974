"""A friction function that fails where a process has contact nodes: no other may wait for it.

Started by test_parallel.py with `mpirun -n 2`; the surface's nodes belong to one process.
"""

import sys

from mpi4py import MPI

import numpy as np

from pw_elements.contact import ContactPair, Plane, solve_contact
from tests.contact_cases import Block

comm = MPI.COMM_WORLD
block = Block(8, comm=comm)
x = comm.allgather(block.owned()[np.isclose(block.owned()[:, 1], 0.0)])
place = next(part for part in x if len(part))[0]


def mu(x):
    if x.size:
        raise KeyError("no friction known")
    return np.zeros(0)


def there(x):
    return np.isclose(x.T, place).all(axis=1)


try:
    pair = ContactPair(there, Plane((0, 0), (0, 1)), mu)
    solve_contact(block.K, block.pressure, block.free, pair, block.space)
except Exception as error:
    sys.stdout.write(f"{type(error).__name__}: {error}\n")  # in one piece
