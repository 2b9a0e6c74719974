"""The harness by which tests run on several processes."""

import pytest

from tests.parallel import run_on, same_numbers


def one_fails(comm):
    print("here is", comm.rank, flush=True)
    comm.barrier()
    if comm.rank == 1:
        raise KeyError("x")
    comm.barrier()


def numbers(comm, shift):
    return {"none": [], "rank": [3.0, 1.0 + shift * (comm.rank > 0)], "a slip": 1e-12 * comm.rank}


def test_who_fails_ends_all_and_each_is_heard():
    with pytest.raises(AssertionError) as caught:
        run_on(2, one_fails)
    for part in ("here is 0", "process 1:\nhere is 1\nTraceback", "KeyError: 'x'"):
        assert part in str(caught.value)


def test_numbers_that_differ_on_one_process_are_named():
    with pytest.raises(AssertionError, match="rank, process 1 of 2"):
        same_numbers(numbers, 4e-10, processes=[2])
