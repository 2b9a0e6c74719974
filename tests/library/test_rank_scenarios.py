"""One process differs, fails or has no number: none waits, and none goes on in silence."""

import pytest

from tests.library import rank_scenarios
from tests.library.test_collective import gather_outcomes
from tests.parallel import run_on

# Seconds that all scenarios may take on a busy machine; a process that waits takes for ever
WAITING = 900
SERIES = ("REFUSED_ON_ONE", "DIFFERENT_ON_ONE", "NAN_ON_ONE", "SAME_OUTCOME")


def all_ends(comm):
    """Ends of all scenarios on all processes, by the name of their series and their own."""
    world, found = rank_scenarios.RankProblem(), {}
    for series in SERIES:
        for name, scenario in getattr(rank_scenarios, series).items():
            print(series, name, flush=True)  # the last one is where a process waits
            found[series, name] = gather_outcomes(comm, lambda run=scenario: run(world))
    return found


@pytest.mark.random
def test_what_differs_on_one_process_ends_all_alike(request):
    processes = 3 if request.config.getoption("--nightly") else 2
    found = run_on(processes, all_ends, limit=WAITING)[0]
    assert len(found) > 100
    unlike = {name: each for name, each in found.items() if len(set(each)) > 1}
    silent = {
        name: each[0]
        for name, each in found.items()
        if (each[0] == "nothing") != (name[0] == "SAME_OUTCOME")
    }
    assert unlike == {}
    assert silent == {}
