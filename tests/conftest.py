"""Options and fixtures of all tests: few fixed random problems, or many with `--nightly`.

The first line of the output gives the number of tests and their duration when they last ran here.
Figures are closed after each test, because some tests count open figures. Waiting MPI processes
yield the core to working ones, so that a time limit can distinguish hung from slow tests.
"""

import os
import sys
from collections import Counter

import pytest
from hypothesis import HealthCheck, settings

os.environ.setdefault("OMPI_MCA_mpi_yield_when_idle", "1")

MAX_CANDIDATES_PER_FACET = 40  # in the mortar's search
ASSUMED_TEST_SECONDS = 0.25  # for a file none of whose tests has run yet


@pytest.fixture(autouse=True)
def _close_figures():
    """Close all Matplotlib figures after each test."""
    yield
    if "matplotlib.pyplot" in sys.modules:
        sys.modules["matplotlib.pyplot"].close("all")


@pytest.fixture(autouse=True)
def _limit_mortar_candidates(monkeypatch):
    """Assert that the mortar's search tests few candidate pairs on every mesh of the suite."""
    if (overlap := sys.modules.get("pw_elements.contact.interface.mortars.overlap")) is None:
        return
    find_candidate_pairs = overlap._find_sub_facet_pairs_with_intersecting_boxes

    def find_and_count_candidate_pairs(slave_sub_facets, master_sub_facets, projection_directions):
        pairs = find_candidate_pairs(slave_sub_facets, master_sub_facets, projection_directions)
        assert len(pairs[0]) <= MAX_CANDIDATES_PER_FACET * max(
            len(slave_sub_facets), len(master_sub_facets)
        )
        return pairs

    monkeypatch.setattr(
        overlap, "_find_sub_facet_pairs_with_intersecting_boxes", find_and_count_candidate_pairs
    )


def pytest_addoption(parser):
    parser.addoption(
        "--nightly",
        action="store_true",
        help="1 600 random contact problems in place of 60, 400 for the second solver in place of "
        "24, 200 at large strains in place of 10, 100 that slide in place of 4, 400 of large "
        "sliding in place of 20, 60 pairs of blocks in place of 6, 5 000 examples of each "
        "property, new ones each time, in place of 25, "
        "contact on three processes in place of two, commands interrupted 80 times and the "
        "study killed 50 times, the study in places that lack something, contact with half a "
        "million unknowns at large strains, and the memory of eight processes",
    )


def pytest_configure(config):
    import tests.parallel  # noqa: F401  extends DOLFINx's time limit; starts MPI, hence not at the top

    suppressed_checks = [
        HealthCheck.too_slow,
        HealthCheck.data_too_large,
        HealthCheck.filter_too_much,
    ]
    common_settings = {
        "deadline": None,
        "database": None,
        "suppress_health_check": suppressed_checks,
    }
    settings.register_profile("suite", max_examples=25, derandomize=True, **common_settings)
    settings.register_profile("nightly", max_examples=5000, print_blob=True, **common_settings)
    settings.load_profile("nightly" if config.getoption("--nightly") else "suite")
    if not hasattr(config, "workerinput"):
        config.pluginmanager.register(DurationReporter(config))


class DurationReporter:
    """Mean duration of the tests of each file in seconds, kept in pytest's cache."""

    def __init__(self, config):
        self.config, self.cache = config, getattr(config, "cache", None)
        self.mean_seconds = self.cache.get("pw_elements/seconds", {}) if self.cache else {}
        self.total_seconds, self.n_tests, self.is_printed = Counter(), Counter(), False

    def summarise(self, ids):
        """Return the number of tests and their expected duration as one line."""
        n_processes = getattr(self.config.option, "numprocesses", None) or 1
        expected_seconds = (
            sum(
                self.mean_seconds.get(test_id.split("::")[0], ASSUMED_TEST_SECONDS)
                for test_id in ids
            )
            / n_processes
        )
        duration = (
            f"{expected_seconds / 60:.0f} min"
            if expected_seconds > 90
            else f"{expected_seconds:.0f} s"
        )
        all_measured = all(test_id.split("::")[0] in self.mean_seconds for test_id in ids)
        basis = "as they last ran here" if all_measured else "not all have run here yet"
        return f"{len(ids)} tests, about {duration} by {n_processes} at a time ({basis})"

    def pytest_report_collectionfinish(self, items):
        return self.summarise([item.nodeid for item in items])

    @pytest.hookimpl(optionalhook=True)
    def pytest_xdist_node_collection_finished(self, ids):
        if not self.is_printed:  # printed for the first worker; all workers collect the same tests
            self.config.get_terminal_writer().line(self.summarise(ids))
        self.is_printed = True

    def pytest_runtest_logreport(self, report):
        file = report.nodeid.split("::")[0]
        self.total_seconds[file] += report.duration
        self.n_tests[file] += report.when == "setup"

    def pytest_sessionfinish(self):
        if self.cache and self.n_tests:
            new_mean_seconds = {
                file: self.total_seconds[file] / count for file, count in self.n_tests.items()
            }
            self.cache.set("pw_elements/seconds", self.mean_seconds | new_mean_seconds)


@pytest.fixture(scope="session")
def results(tmp_path_factory, worker_id):
    """Return the study's results, each computed on first use, once for all workers."""
    from tests.study.computed_results import ComputedResults

    base = tmp_path_factory.getbasetemp()
    return ComputedResults((base if worker_id == "master" else base.parent) / "computed")
