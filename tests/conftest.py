"""How many random problems are tried: few in the suite, always the same; many in `--nightly`.

No test leaves figures open, for others count them. MPI's processes that wait leave the core to
those that work: as fast as ever on a busy machine, where a time limit must tell hung from slow.
"""

import os
import sys

import pytest
from hypothesis import HealthCheck, settings

os.environ.setdefault("OMPI_MCA_mpi_yield_when_idle", "1")


@pytest.fixture(autouse=True)
def _closed_figures():
    yield
    if "matplotlib.pyplot" in sys.modules:
        sys.modules["matplotlib.pyplot"].close("all")


def pytest_addoption(parser):
    parser.addoption(
        "--nightly",
        action="store_true",
        help="1 600 random contact problems in place of 60, 400 for the second solver in place of "
        "40, 200 at large strains in place of 10, 5 000 examples of each property, new ones each "
        "time, in place of 200, and the study interrupted 80 times and killed 50 times",
    )


def pytest_configure(config):
    slow = [HealthCheck.too_slow, HealthCheck.data_too_large, HealthCheck.filter_too_much]
    common = {"deadline": None, "database": None, "suppress_health_check": slow}
    settings.register_profile("suite", max_examples=200, derandomize=True, **common)
    settings.register_profile("nightly", max_examples=5000, print_blob=True, **common)
    settings.load_profile("nightly" if config.getoption("--nightly") else "suite")
