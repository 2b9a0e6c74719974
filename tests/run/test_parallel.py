"""Tests of the helpers that run a function on several MPI processes."""

import pytest

from tests.parallel import assert_same_on_processes, run_on_processes


def fail_on_process_1(comm):
    """Print the rank of this process, and raise KeyError on process 1."""
    print("here is", comm.rank, flush=True)
    comm.barrier()
    if comm.rank == 1:
        raise KeyError("x")
    comm.barrier()


def return_numbers_shifted_on_later_ranks(comm, shift):
    """Return arrays by name; one value is larger by `shift` on all processes except the first."""
    return {"none": [], "rank": [3.0, 1.0 + shift * (comm.rank > 0)], "a slip": 1e-12 * comm.rank}


def test_a_failing_process_ends_all_and_every_output_is_reported():
    with pytest.raises(AssertionError) as caught:
        run_on_processes(2, fail_on_process_1)
    for part in ("here is 0", "process 1:\nhere is 1\nTraceback", "KeyError: 'x'"):
        assert part in str(caught.value)


def test_numbers_that_differ_on_one_process_are_named():
    with pytest.raises(AssertionError, match="rank, process 1 of 2"):
        assert_same_on_processes(return_numbers_shifted_on_later_ranks, 4e-10, process_counts=[2])
