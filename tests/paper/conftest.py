import pytest

from tests.study.computed_results import ComputedResults


@pytest.fixture(scope="session")
def results(tmp_path_factory, worker_id):
    """The study's results, each computed when a test asks for it."""
    base = tmp_path_factory.getbasetemp()
    return ComputedResults((base if worker_id == "master" else base.parent) / "computed")
