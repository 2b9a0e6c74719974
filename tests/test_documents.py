import re
from pathlib import Path

from mpi4py import MPI

import pytest
import ufl
from dolfinx import fem, mesh

import pw_elements.algebra.linear

PROJECT = Path(__file__).parents[1]
CENTRE = 0.0736713  # of -Δu = 1 on the unit square with u = 0 around, the classical value


def test_the_example_of_the_readme_runs():
    (code,) = re.findall(r"```python\n(.*?)```", (PROJECT / "README.md").read_text(), re.DOTALL)
    names: dict = {}
    exec(code, names)
    assert names["a"].max()[1] == pytest.approx(CENTRE, rel=1e-3)


def test_the_example_of_the_algebra_runs():
    code = "\n".join(re.findall(r"^    (.*)$", pw_elements.algebra.linear.__doc__, re.MULTILINE))
    square = mesh.create_unit_square(MPI.COMM_SELF, 8, 8)
    square.topology.create_connectivity(1, 2)
    names = {**vars(pw_elements), "ufl": ufl, "fem": fem, "mesh": square}
    exec(code, names | {"exterior_facet_indices": mesh.exterior_facet_indices}, found := {})
    assert found["a"].max()[1] == pytest.approx(CENTRE, rel=1e-3)


def test_the_readme_names_files_that_exist():
    named = re.findall(
        r"`((?:study|pw_elements|figures)/[\w/*]+\.\w+)`", (PROJECT / "README.md").read_text()
    )
    assert len(named) > 10
    for name in named:
        assert list(PROJECT.glob(name)), name
