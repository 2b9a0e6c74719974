"""Errors on one process only, the last: all processes have to end with the same words, at once.

Started by test_collective.py with `mpirun -n 2` and 3; names of scenarios choose some of them.
Prints, as JSON, what each process said in each scenario.
"""

import faulthandler
import json
import sys

from mpi4py import MPI

from pw_elements.collective import agree, answer, collective

COMM = MPI.COMM_WORLD
BAD = COMM.rank == COMM.size - 1  # the process where things go wrong
# A process that waits for another longer than this waits for ever
PATIENCE = 60


def raises(*_):
    raise KeyError("x")


def check_fails():
    with collective(COMM):
        if BAD:
            raise ArithmeticError("one plus one is three")


def different_words():
    with collective(COMM):
        raise ArithmeticError(f"process {COMM.rank}")


def callback_fails():
    with collective(COMM):
        answer(COMM, "the marker", raises if BAD else bool, 0)


def arguments_differ():
    agree(COMM, {"friction": 0.3, "most": 2 if BAD else 3})


SCENARIOS = [check_fails, different_words, callback_fails, arguments_differ]


def said(scenario):
    faulthandler.dump_traceback_later(PATIENCE, exit=True)
    try:
        scenario()
        words = "nothing"
    except Exception as error:
        words = f"{type(error).__name__}: {error}"
    each = COMM.gather(words)
    faulthandler.cancel_dump_traceback_later()
    return each


outcomes = {
    scenario.__name__: said(scenario)
    for scenario in SCENARIOS
    if not sys.argv[1:] or scenario.__name__ in sys.argv[1:]
}
if COMM.rank == 0:
    sys.stdout.write(json.dumps(outcomes) + "\n")
