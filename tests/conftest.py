"""How many random problems are tried: few in the suite, always the same; many in `--nightly`.

The first line tells the number of tests, and how long they took when they last ran here. No test
leaves figures open, for others count them. MPI's processes that wait leave the core to those that
work: as fast as ever on a busy machine, where a time limit must tell hung from slow.
"""

import os
import sys
from collections import Counter

import pytest
from hypothesis import HealthCheck, settings

os.environ.setdefault("OMPI_MCA_mpi_yield_when_idle", "1")

CANDIDATES = 40  # for a sub-facet
ASSUMED = 0.25  # seconds of a test, before any of its file has run


@pytest.fixture(autouse=True)
def _closed_figures():
    yield
    if "matplotlib.pyplot" in sys.modules:
        sys.modules["matplotlib.pyplot"].close("all")


@pytest.fixture(autouse=True)
def _few_candidates(monkeypatch):
    """The mortar's search asks about few pairs on each of the suite's meshes."""
    if (mortar := sys.modules.get("pw_elements.contact.interface.mortar")) is None:
        return
    candidates = mortar._find_candidate_pairs

    def counted(slave, master, along):
        found = candidates(slave, master, along)
        assert len(found[0]) <= CANDIDATES * max(len(slave), len(master))
        return found

    monkeypatch.setattr(mortar, "_find_candidate_pairs", counted)


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
    import tests.parallel  # noqa: F401  has DOLFINx wait longer; starts MPI, so not above

    slow = [HealthCheck.too_slow, HealthCheck.data_too_large, HealthCheck.filter_too_much]
    common = {"deadline": None, "database": None, "suppress_health_check": slow}
    settings.register_profile("suite", max_examples=25, derandomize=True, **common)
    settings.register_profile("nightly", max_examples=5000, print_blob=True, **common)
    settings.load_profile("nightly" if config.getoption("--nightly") else "suite")
    if not hasattr(config, "workerinput"):
        config.pluginmanager.register(Clock(config))


class Clock:
    """Seconds of tests: their mean in each file, kept in pytest's cache."""

    def __init__(self, config):
        self.config, self.cache = config, getattr(config, "cache", None)
        self.means = self.cache.get("pw_elements/seconds", {}) if self.cache else {}
        self.seconds, self.counts, self.told = Counter(), Counter(), False

    def line(self, ids):
        processes = getattr(self.config.option, "numprocesses", None) or 1
        total = sum(self.means.get(one.split("::")[0], ASSUMED) for one in ids) / processes
        long = f"{total / 60:.0f} min" if total > 90 else f"{total:.0f} s"
        known = all(one.split("::")[0] in self.means for one in ids)
        basis = "as they last ran here" if known else "not all have run here yet"
        return f"{len(ids)} tests, about {long} by {processes} at a time ({basis})"

    def pytest_report_collectionfinish(self, items):
        return self.line([item.nodeid for item in items])

    @pytest.hookimpl(optionalhook=True)
    def pytest_xdist_node_collection_finished(self, ids):
        if not self.told:  # by the first worker; all collect the same
            self.config.get_terminal_writer().line(self.line(ids))
        self.told = True

    def pytest_runtest_logreport(self, report):
        file = report.nodeid.split("::")[0]
        self.seconds[file] += report.duration
        self.counts[file] += report.when == "setup"

    def pytest_sessionfinish(self):
        if self.cache and self.counts:
            new = {file: self.seconds[file] / count for file, count in self.counts.items()}
            self.cache.set("pw_elements/seconds", self.means | new)


@pytest.fixture(scope="session")
def results(tmp_path_factory, worker_id):
    """The study's results, each computed when a test asks for it, once for all workers."""
    from tests.study.computed_results import ComputedResults

    base = tmp_path_factory.getbasetemp()
    return ComputedResults((base if worker_id == "master" else base.parent) / "computed")
