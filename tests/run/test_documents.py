import io
import re
import runpy
import shutil
from contextlib import chdir, redirect_stdout
from pathlib import Path

from mpi4py import MPI

import matplotlib.pyplot as plt
import pytest
import ufl
from dolfinx import fem, mesh

import pw_elements.algebra
from study.judge.claims import GRADES, PAPER, load_claims
from study.judge.facts import load_facts
from study.judge.measures.beam import computed_ratio, exact_ratio
from study.paper.items import TABLE_2
from tests.study.computed_results import ComputedResults

PROJECT = Path(__file__).parents[2]
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
    readme = (PROJECT / "README.md").read_text()
    named = re.findall(r"`((?:study|pw_elements|figures|tests)/[\w/*]+\.\w+)`", readme)
    named += re.findall(r"\]\(([\w./-]+)\)", readme)
    assert len(named) > 15
    for name in named:
        assert list(PROJECT.glob(name)), name


def test_the_readme_is_short_and_has_the_words_that_are_looked_for():
    words = (PROJECT / "README.md").read_text().split()
    assert len(words) <= 700
    assert {"Basix", "UFL", "CPS6", "Euler", "pytest"} <= {
        word for part in words for word in re.findall(r"[A-Za-z0-9]+", part)
    }


def test_the_readme_counts_the_statements_as_they_are_graded():
    grades = [claim.grade for claim in load_claims() if claim.kind in PAPER]
    counts = ", ".join(f"{grades.count(grade)} {grade}" for grade in GRADES if grade in grades)
    first, _, others = counts.partition(" ")
    readme = " ".join((PROJECT / "README.md").read_text().split())
    assert f"Of {len(grades)} statements of the paper, {first} are {others}." in readme
    assert f"They rest on {len(load_facts())} independent facts." in readme


def test_the_readme_has_the_differences_of_table_2():
    lower = [100 * (1 - TABLE_2["6-node user element"][i] / TABLE_2["CPS6"][i]) for i in (0, 1)]
    readme = " ".join((PROJECT / "README.md").read_text().split())
    assert "in the paper's Table 2 it is lower by {:.1f} % and {:.1f} %".format(*lower) in readme


def test_the_readme_has_the_computed_differences_of_critical_stresses(tmp_path):
    results = ComputedResults(tmp_path)
    readme = " ".join((PROJECT / "README.md").read_text().split())
    lower = [-computed_ratio(results, "pw-T6", "galerkin-T6", mode) for mode in (1, 2)]
    exact = [-exact_ratio(results, "G", "euler", mode) for mode in (1, 2)]
    assert "lower the critical stress by {:.1g} % and {:.1g} %".format(*lower) in readme
    assert "the exact plane-stress values are {:.0f} % and {:.0f} % lower".format(*exact) in readme


ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
PROGRAMS = sorted(
    path
    for path in DOCS.rglob("*.md")
    if "```python" in path.read_text() and path.name != "your-own-problem.md"  # has its own tests
)


def program(page):
    return "\n\n".join(re.findall(r"```python\n(.*?)```", page.read_text(), re.DOTALL))


@pytest.mark.parametrize("page", PROGRAMS, ids=lambda page: page.stem)
def test_code_of_the_page_runs(page, tmp_path):
    shutil.copy(ROOT / "examples" / "gasket.msh", tmp_path)
    file = tmp_path / "program.py"
    file.write_text(program(page))
    try:
        with chdir(tmp_path), redirect_stdout(io.StringIO()):
            names = runpy.run_path(str(file))
    finally:
        plt.close("all")
    assert names


def test_what_has_to_be_told_has_a_page():
    told = {path.stem for path in (DOCS / "how-to").glob("*.md")}
    assert told == {
        "index",
        "meshes",
        "materials",
        "which-method",
        "results",
        "friction",
        "large-strains",
        "restart",
        "parallel",
        "solvers",
        "paraview",
        "coupling",
    }
    listed = (DOCS / "how-to" / "index.md").read_text()
    assert all(f"\n{page}\n" in listed for page in told - {"index"})


def test_links_within_the_guide_lead_somewhere():
    """Pages that are made (gallery, reference, evidence) are looked at in the browser."""
    for page in DOCS.rglob("*.md"):
        for target in re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", page.read_text()):
            if target.removeprefix("../").split("/")[0] in ("gallery", "reference", "evidence"):
                continue
            path = page.parent / target
            assert path.is_file() or path.with_suffix(".md").is_file(), f"{page.name}: {target}"
