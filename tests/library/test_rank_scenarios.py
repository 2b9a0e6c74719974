"""Errors, differences and NaN on one process end all processes in the same way, without waiting."""

import pytest

from tests.library import rank_scenarios
from tests.library.test_collective import gather_error_messages
from tests.parallel import run_on

# Seconds that all scenarios may take on a busy machine; a process that waits takes forever
SCENARIOS_TIMEOUT_SECONDS = 900
SCENARIO_LIST_NAMES = (
    "CALLS_INVALID_ON_ONE_RANK",
    "CALLS_DIFFERENT_ON_ONE_RANK",
    "CALLS_NAN_ON_ONE_RANK",
    "CALLS_SUCCEEDING_ON_ALL_RANKS",
)


def gather_outcomes_of_all_scenarios(comm):
    """Return the outcomes of all scenarios on all processes, by series and name."""
    world, outcomes = rank_scenarios.BlockWithDifferingRank(), {}
    for series in SCENARIO_LIST_NAMES:
        for name, scenario in getattr(rank_scenarios, series).items():
            print(series, name, flush=True)  # where a process waits, this is the last line
            outcomes[series, name] = gather_error_messages(comm, lambda run=scenario: run(world))
    return outcomes


@pytest.mark.random
def test_an_error_on_one_process_ends_all_processes(request):
    processes = 3 if request.config.getoption("--nightly") else 2
    outcomes = run_on(processes, gather_outcomes_of_all_scenarios, limit=SCENARIOS_TIMEOUT_SECONDS)[
        0
    ]
    assert len(outcomes) > 100
    unlike = {name: by_rank for name, by_rank in outcomes.items() if len(set(by_rank)) > 1}
    silent = {
        name: by_rank[0]
        for name, by_rank in outcomes.items()
        if (by_rank[0] == "nothing") != (name[0] == "CALLS_SUCCEEDING_ON_ALL_RANKS")
    }
    assert unlike == {}
    assert silent == {}
