"""An error, a difference or NaN on one process raises the same error on all; none hangs."""

import pytest

from tests.library import rank_scenarios
from tests.library.test_collective import gather_error_messages
from tests.parallel import run_on_processes

# Seconds that all scenarios may take on a busy machine; a process that hangs exceeds any limit
SCENARIOS_TIMEOUT_SECONDS = 900
SCENARIO_LIST_NAMES = (
    "CALLS_INVALID_ON_ONE_RANK",
    "CALLS_DIFFERENT_ON_ONE_RANK",
    "CALLS_NAN_ON_ONE_RANK",
    "CALLS_SUCCEEDING_ON_ALL_RANKS",
)


def gather_outcomes_of_all_scenarios(comm):
    """Return the outcomes of each scenario on all processes, by (series, name)."""
    world, outcomes = rank_scenarios.BlockWithDifferingRank(), {}
    for series in SCENARIO_LIST_NAMES:
        for name, scenario in getattr(rank_scenarios, series).items():
            print(series, name, flush=True)  # the last line of a process that hangs
            outcomes[series, name] = gather_error_messages(comm, lambda run=scenario: run(world))
    return outcomes


@pytest.mark.random
def test_an_error_on_one_process_ends_all_processes(request):
    processes = 3 if request.config.getoption("--nightly") else 2
    outcomes = run_on_processes(
        processes, gather_outcomes_of_all_scenarios, limit=SCENARIOS_TIMEOUT_SECONDS
    )[0]
    assert len(outcomes) > 100
    unlike = {name: by_rank for name, by_rank in outcomes.items() if len(set(by_rank)) > 1}
    silent = {
        name: by_rank[0]
        for name, by_rank in outcomes.items()
        if (by_rank[0] == "nothing") != (name[0] == "CALLS_SUCCEEDING_ON_ALL_RANKS")
    }
    assert unlike == {}
    assert silent == {}
