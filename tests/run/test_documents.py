"""The README: its example runs, its files exist, and its numbers agree with the study."""

import re
from pathlib import Path

import pytest

from study.judge.claims import GRADES, load_paper_claims
from study.judge.facts import load_facts
from study.judge.measures.beam import exact_stress_difference, stress_change_by_weights
from study.judge.measures.engineering import (
    answer_changes,
    largest_rule_error,
    least_rule_error,
    middle_distance,
    n_changed_answers,
)
from study.paper.items import TABLE_2

ROOT = Path(__file__).parents[2]
# u at the centre of the unit square with -Δu = 1 and u = 0 on the boundary
POISSON_CENTRE_VALUE = 0.0736713


def test_the_example_of_the_readme_runs():
    (code,) = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(), re.DOTALL)
    names: dict = {}
    exec(code, names)
    assert names["a"].max()[1] == pytest.approx(POISSON_CENTRE_VALUE, rel=1e-3)


def test_the_readme_names_files_that_exist():
    readme = (ROOT / "README.md").read_text()
    paths = re.findall(r"`((?:study|pw_elements|figures|tests)/[\w/*]+\.\w+)`", readme)
    paths += re.findall(r"\]\(([\w./-]+)\)", readme)
    assert len(paths) > 15
    for name in paths:
        assert list(ROOT.glob(name)), name


def test_the_readme_is_short_and_contains_the_required_words():
    words = (ROOT / "README.md").read_text().split()
    assert len(words) <= 600
    assert {"Basix", "UFL", "CPS6", "Euler", "pytest"} <= {
        word for text in words for word in re.findall(r"[A-Za-z0-9]+", text)
    }


def test_the_abstract_of_the_citation_has_sentences_of_the_readme():
    yaml = pytest.importorskip("yaml")
    abstract = yaml.safe_load((ROOT / "CITATION.cff").read_text())["abstract"].strip()
    readme = (ROOT / "README.md").read_text()
    text = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", readme)  # links without their targets
    text = " ".join(re.sub(r"[*`]", "", text).split())
    sentences = re.split(r"(?<=[a-z][a-z]\.) (?=[A-Z])", abstract)
    assert len(sentences) == 5
    for sentence in sentences:
        assert sentence in text, sentence


def test_the_readme_gives_the_numbers_of_statements_by_grade():
    grades = [claim.grade for claim in load_paper_claims()]
    counts = ", ".join(f"{grades.count(grade)} {grade}" for grade in GRADES if grade in grades)
    n_reproduced, _, other_counts = counts.partition(" ")
    readme = " ".join((ROOT / "README.md").read_text().split())
    assert f"Of {len(grades)} statements of the paper, {n_reproduced} are {other_counts}." in readme
    assert f"They rest on {len(load_facts())} independent facts." in readme


def test_the_readme_gives_the_differences_of_table_2():
    lower = [100 * (1 - TABLE_2["6-node user element"][i] / TABLE_2["CPS6"][i]) for i in (0, 1)]
    readme = " ".join((ROOT / "README.md").read_text().split())
    assert "Table 2 is lower by {:.1f} % and {:.1f} %, unexplained".format(*lower) in readme


def test_the_readme_gives_the_computed_differences_of_critical_stresses(results):
    readme = " ".join((ROOT / "README.md").read_text().split())
    least_at_corner, largest_at_corner, least_at_midside, largest_at_midside = (
        extreme(stress_change_by_weights(results, group, name, mode) for mode in (1, 2))
        for group in ("corner", "midside")
        for name, extreme in (("least", min), ("largest", max))
    )
    exact = [-exact_stress_difference(results, "G", "euler", mode) for mode in (1, 2)]
    at_corner = f"{least_at_corner:.1g} to {largest_at_corner:.1g} % (load at a corner)"
    at_midside = f"{least_at_midside:.2g} to {largest_at_midside:.2g} % (mid-side)"
    assert f"weights alone change buckling stresses by {at_corner}, {at_midside}" in readme
    assert "the exact plane-stress values are {:.0f} % and {:.0f} % lower".format(*exact) in readme


def test_the_readme_gives_the_errors_of_section_w(results):
    readme = " ".join((ROOT / "README.md").read_text().split())
    errors = [100 * f(results, "wear", "T10") for f in (least_rule_error, largest_rule_error)]
    assert "usual rules do not (worn depths: {:.1g} to {:.3g} %)".format(*errors) in readme
    changing = (("wear", "", 0), ("submodel", "", 0), ("friction", "stick_", 1))
    for problem, name, rank in changing:
        assert answer_changes(results, problem, "T10", name, rank)
        distance = 100 * middle_distance(results, problem, "T10", name, rank)
        assert round(distance) in (2, 3)  # "coarse tetrahedra (2 to 3 %)"
    assert sum(n_changed_answers(results, rank) for rank in range(3)) == len(changing)
