"""The harness by which tests run on several processes."""

import time

import pytest

from tests.parallel import run_on, same_numbers


def one_fails(comm):
    print("here is", comm.rank, flush=True)
    comm.barrier()
    if comm.rank == 1:
        raise KeyError("x")
    comm.barrier()


def hangs(_):
    time.sleep(3600)


def numbers(comm, shift):
    return {
        "same": 1.0,
        "none": [],
        "rank": [3.0, 1.0 + shift * (comm.rank > 0)],
        "a slip": 1e-12 * comm.rank,
    }


@pytest.mark.parametrize(
    ("function", "limit", "words"),
    [
        (one_fails, 1800, ["here is 0", "process 1:\nhere is 1\nTraceback", "KeyError: 'x'"]),
        (hangs, 1, ["process 0:\nTimeout", "in hangs"]),
    ],
)
def test_who_fails_or_hangs_ends_all_and_each_is_heard(function, limit, words):
    with pytest.raises(AssertionError) as caught:
        run_on(2, function, limit=limit)
    for part in words:
        assert part in str(caught.value)


def test_numbers_that_differ_on_one_process_are_named():
    same_numbers(numbers, 2e-10)
    with pytest.raises(AssertionError, match="rank, process 1 of 3"):
        same_numbers(numbers, 4e-10)
