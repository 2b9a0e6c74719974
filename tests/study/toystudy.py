"""Provide a small study for tests.

`python3 -m tests.study.toystudy DIR` writes its report to the folder DIR.
"""

import json
import sys
from functools import partial
from pathlib import Path
from types import ModuleType

import pytest

from study.judge import claims, facts
from study.publish.command import FigureDrawingFunctions
from study.publish.report import build_report
from study.run.cases import SECTIONS
from study.run.store import Result, Results, save, write_json

FIRST_SECTION_SOURCE = """
import os
import time
from pathlib import Path

import numpy as np

from study.run.cases import Case
from study.run.store import Result
from toy.common import FACTOR

TITLE = "First toy"
UNITS = {"y": "N", "iterations": "1"}


def run(value, log, do=""):
    with Path(log).open("a") as stream:
        stream.write(f"{os.getpid()}\\n")
    if do == "raise":
        raise ArithmeticError("no convergence\\nand a second line")
    if do == "die":
        os._exit(9)
    if do == "sleep":
        time.sleep(60)
    return Result({"y": FACTOR * value, "iterations": 3}, UNITS, {"x": np.arange(3.0)}, dofs=6)


def case(name, value=1.0, **parameters):
    return Case("1", name, run, {"value": value, "log": os.environ["TOY_LOG"], **parameters})


CASES = [case("a"), case("b", 2.5)]
"""

SECOND_SECTION_SOURCE = """
from study.run.cases import Case
from study.run.store import Result

TITLE = "Second toy"


def run():
    return Result({"z": 7.0}, {"z": "1"})


CASES = [Case("2", "only", run)]
"""

MEASURES_SOURCE = """
def value(results, key, name, factor=1.0):
    return factor * results.scalar(key, name)


def broken(results):
    return 1 / 0


def nothing(results):
    return float("nan")
"""


SVG_PICTURE = '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 9 9"><path d="M0 0L9 9"/></svg>'

TOY_PARAMETERS = {"problem": "toy"}
TOY_PROVENANCE = {
    "commit": "0123456789abcdef", "dirty": True, "time": "2026-01-02T03:04:05+00:00",
    "versions": {"dolfinx": "0.9.0", "numpy": "2.2.4"},
    "seconds": 1.239, "dofs": 4290, "processes": 2, "fingerprint": "f",
}  # fmt: skip


def make_claim_toml(**changes):
    """Return a statement of the paper as TOML with changed entries; None omits an entry."""
    entry = {
        "id": '"the-claim"', "kind": '"paper"', "source": '"Sec. 1, Eq. 3"',
        "quote": '"a force of 5"', "statement": '"The force is 5 N."',
        "grade": '"reproduced"', "grade_why": '"A computed force."',
        "measure": '"value"', "args": '{ key = "1/b", name = "y" }', "relation": '"="',
        "value": "5.0", "tol": "1e-12", "tol_why": '"Round-off."', "tol_set": '"after"',
        "unit": '"N"', "why": '"Twice 2.5."',
    } | changes  # fmt: skip
    toml_lines = [f"{key} = {value}" for key, value in entry.items() if value is not None]
    return "\n".join(["[[claim]]", *toml_lines, ""])


def make_finding_toml(**changes):
    """Return a finding of the study as TOML with changed entries; None omits an entry."""
    paper_only_keys = dict.fromkeys(("kind", "quote", "grade", "grade_why"))
    entry = {"source": '"This study, section 1"', "pinned": '"holds"', **paper_only_keys, **changes}
    return make_claim_toml(**entry).replace("[[claim]]", "[[finding]]")


def make_module_from_source(name, source, **attributes):
    new_module = ModuleType(name)
    new_module.__dict__.update(attributes)
    exec(source, new_module.__dict__)
    return new_module


TOY_MEASURES_MODULE = make_module_from_source("toy_measures", MEASURES_SOURCE)


def install_toy_study(folder, monkeypatch):
    """Replace sections, claims and measures by those of a toy study with sources in `folder`."""
    package = folder / "toy"
    package.mkdir()
    sources = {
        "__init__": "",
        "common": "FACTOR = 2.0\n",
        "one": FIRST_SECTION_SOURCE,
        "two": SECOND_SECTION_SOURCE,
    }
    for name, source in sources.items():
        (package / f"{name}.py").write_text(source)
    for name in [name for name in sys.modules if name.split(".")[0] == "toy"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.syspath_prepend(str(folder))
    monkeypatch.setenv("TOY_LOG", str(folder / "log"))
    for section in reversed([*SECTIONS]):  # monkeypatch then restores them in their original order
        monkeypatch.delitem(SECTIONS, section)
    monkeypatch.setitem(SECTIONS, "1", "toy.one")
    monkeypatch.setitem(SECTIONS, "2", "toy.two")
    path = folder / "claims.toml"
    path.write_text(make_claim_toml())
    monkeypatch.setattr(
        claims, "load_claims", partial(claims.read_claims, [path], TOY_MEASURES_MODULE)
    )


def write_toy_results(folder, monkeypatch):
    """Install the toy study; return a folder with its results, claims and three figures."""
    install_toy_study(folder, monkeypatch)
    results_folder = folder / "results"
    save(
        results_folder,
        "1",
        "a",
        Result({"y": 2.54973e9}, {"y": "Pa"}, {"x": [1.0, 2.0]}),
        TOY_PARAMETERS,
        TOY_PROVENANCE,
    )
    versions = {**TOY_PROVENANCE["versions"], "dolfinx": "0.10.0"}
    other_provenance = {**TOY_PROVENANCE, "versions": versions, "dirty": False}
    save(results_folder, "1", "b", Result({"y": 5.0}, {"y": "1"}), TOY_PARAMETERS, other_provenance)
    claims_path = folder / "claims.toml"
    claims_path.write_text(
        make_claim_toml()
        + make_claim_toml(id='"wrong"', value=4.0, source='"Table 1"')
        + make_claim_toml(id='"open"', args='{ key = "7/no", name = "y" }', source='"Sec. 2"')
    )
    results = Results(results_folder)
    facts.write_claims_with_facts(
        results_folder, claims.judge_claims(claims.load_claims(), results), results
    )
    write_toy_figures(results_folder, ("fig05", "1"), ("tab2", "1"), ("orders", "9"))
    return results_folder


def write_toy_figures(results_folder, *names_and_sections):
    sizes = {"width": 672, "height": 288, "narrow": [355, 400]}
    entries = [
        {"name": name, "title": f"Title of {name}", "section": section, **sizes}
        | {"caption": f"Caption of {name}: a < b.", "alt": f'Line "{name}"'}
        for name, section in names_and_sections
    ]
    figures_folder = results_folder / "figures"
    figures_folder.mkdir(exist_ok=True)
    (figures_folder / "index.json").write_text(json.dumps(entries))
    for name, _ in names_and_sections:
        for suffix in ("svg", "narrow.svg"):
            (figures_folder / f"{name}.{suffix}").write_text(SVG_PICTURE)


def count_started_runs(folder):
    log = folder / "log"
    return len(log.read_text().split()) if log.exists() else 0


def _write_empty_figure_index(out, *_):
    write_json(out / "figures" / "index.json", [])
    return True


EMPTY_FIGURE_DRAWING = FigureDrawingFunctions(
    list_needs="", draw="", draw_outdated_figures=_write_empty_figure_index
)
"""Drawing functions of the toy study, which has no figures: the index of figures is empty."""


if __name__ == "__main__":
    folder = Path(sys.argv[1]).resolve()
    folder.mkdir(parents=True)
    with pytest.MonkeyPatch.context() as patch:
        results = write_toy_results(folder, patch)
        build_report(Results(results), folder)
