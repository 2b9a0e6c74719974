"""NaN in the load of the last process: all of them have to notice, in statics and contact.

Started by test_parallel.py with `mpirun -n 2` and 3.
"""

import sys

from mpi4py import MPI

import numpy as np

from pw_elements import Reduction, prescribe, solve
from pw_elements.contact import solve_contact
from tests.contact_cases import Block, at

comm = MPI.COMM_WORLD
block = Block(8, comm=comm)
load = block.pressure.copy()
if comm.rank == comm.size - 1:
    load.array[:] = np.nan
held = Reduction.dirichlet(block.space, [prescribe(block.space, i, at(1, 0.0)) for i in (0, 1)])
for call in (
    lambda: solve(block.K, load, held),
    lambda: solve_contact(block.K, load, block.free, block.pair(0.3), block.space),
):
    try:
        call()
        said = "nothing"
    except Exception as error:
        said = f"{type(error).__name__}: {error}"
    sys.stdout.write(f"{said}\n")  # in one piece
