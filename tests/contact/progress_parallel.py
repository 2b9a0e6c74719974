"""What is told of a contact problem on several processes, and users' functions that fail.

Started by test_contact_progress.py with `mpirun -n 2`; prints one line for each finding.
"""

import logging
import sys

from mpi4py import MPI

from pw_elements.contact import solve_contact
from tests.contact.cases import Block

comm = MPI.COMM_WORLD
block = Block(8, comm=comm)
block.pressure.scale(0.01)  # small displacements


class Enough(Exception):
    """Ends a computation."""


def local():
    class More(Exception):
        def __init__(self, one, two):
            super().__init__(f"{one} and {two}")

    return More("one", "two")


def say(*words):
    line = " ".join(map(str, [comm.rank, *words]))
    sys.stdout.write(f"{line}\n")  # at once, that the lines of two processes do not mix
    sys.stdout.flush()


def solved(callback):
    return solve_contact(
        block.K, block.pressure, block.free, block.pair(0.3), block.space, callback=callback
    )


def fails_on_the_last(_):
    if comm.rank == comm.size - 1:
        raise Enough("enough")


try:
    solved(fails_on_the_last)
except Enough as error:
    say("Enough", error)


def fails_locally(_):
    if comm.rank == 0:
        raise local()


try:
    solved(fails_locally)
except Exception as error:
    say(type(error).__name__, error)

seen = []
(state,) = solved(seen.append if comm.rank == 1 else None)
say("called", len(seen) == state.iterations + 1 if comm.rank == 1 else not seen)

logging.basicConfig(level=logging.INFO, stream=sys.stdout, format=f"{comm.rank} %(message)s")
if comm.rank == 0:  # whoever listens on one process only must not stop the others
    logging.getLogger("pw_elements.contact").setLevel(logging.DEBUG)
solved(None)
