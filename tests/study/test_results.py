"""What every result states, with suitable units; figures, claims and texts ask for known cases."""

import re
from fnmatch import fnmatchcase
from pathlib import Path

import pytest

from figures.drawing import load_script, scripts
from study.judge.claims import load_claims
from study.judge.measures.general import largest
from study.judge.measures.stored_cases import like, matching
from study.model.units import DIMENSIONLESS_UNITS, KN_M_UNITS, N_MM_UNITS, SI_UNITS, UNSTATED_UNITS
from study.model.vocabulary import ELEMENTS
from study.publish import texts
from study.publish.texts import BLOCKS
from study.run.cases import SECTIONS, find_page_source, load_section
from study.run.expected import read_expected_table
from study.run.pages import read_constants
from study.run.store import StoredResult

CASES = {case.key: case for section in SECTIONS for case in load_section(section).cases}


def quickest_cases():
    """Return the keys of one computed case of each problem, that of the shortest expected time."""
    by_problem = {}
    for key, case in CASES.items():
        if not case.record:
            by_problem.setdefault((case.section, case.run.__name__), []).append(key)
    seconds = read_expected_table()
    return [min(keys, key=lambda key: seconds.get(key, 0.0)) for keys in by_problem.values()]


QUICKEST = [
    pytest.param(key, marks=[pytest.mark.slow] * (read_expected_table().get(key, 0.0) > 3.0))
    for key in quickest_cases()
]
UNIT_SYSTEMS = (UNSTATED_UNITS, DIMENSIONLESS_UNITS, N_MM_UNITS, KN_M_UNITS, SI_UNITS)
OTHER_UNITS = {"1", "s", "MB", "1/s²", "1000/s²", "Pa"}
# What names say, whatever the section; the first pattern counts
KINDS = {
    "1": "error* smallest_* *_error order* *difference* *residual* iterations* imaginary* ratio* "
    "sawtooth* peak_over_mean*",
    "force": "*force* reaction_*",
    "stress": "peak_pressure* mean_pressure sigma_cr_*",
    "length": "closed_* stick_from* translation *radius*",
}
NAMED = {pattern: kind for kind, patterns in KINDS.items() for pattern in patterns.split()}


def is_element(name):
    """Whether it is one of ours; those of CalculiX have another parameter."""
    return name in ELEMENTS and name != "exact"


@pytest.mark.parametrize("section", SECTIONS)
def test_every_case_states_its_element_where_it_has_one(section):
    cases = [case for case in CASES.values() if case.section == section]
    for case in cases:
        stated = case.stored_parameters
        assert stated["problem"], case.key
        assert {*case.parameters, *case.implied} <= set(stated), case.key
        if "element" in stated:
            assert is_element(stated["element"]), case.key
        elif "compared" in stated:
            assert stated["compared"], case.key
            assert all(map(is_element, stated["compared"])), case.key
        elif "peer_element" in stated:
            assert not is_element(stated["peer_element"]), case.key
        else:
            assert stated["problem"] in ("exact", "trefftz", "reference") or stated["method"], (
                case.key
            )


@pytest.mark.parametrize("section", SECTIONS)
def test_parameters_tell_cases_apart(section):
    stated = [case.stored_parameters for case in CASES.values() if case.section == section]
    assert all(stated.count(one) == 1 for one in stated)


def test_element_in_a_name_is_the_one_stated():
    for key, case in CASES.items():
        element = case.stored_parameters.get("element")
        named = [name for name in ELEMENTS if f"-{name}-" in f"-{case.name}-"]
        if element and named:
            assert named == [element], key


@pytest.mark.parametrize("key", QUICKEST)
def test_every_number_has_a_suitable_unit(key, results):
    case, read = CASES[key], results[key]
    assert read.parameters == case.stored_parameters
    assert set(read.units) == set(read.scalars)
    suitable = [
        units
        for units in map(vars, UNIT_SYSTEMS)
        if set(read.units.values()) <= {*units.values()} | OTHER_UNITS and _has_units(read, units)
    ]
    assert suitable, read.units


def _has_units(result, units):
    """Whether numbers whose names tell their kind have the unit of this kind."""
    for name, unit in result.units.items():
        kind = next((NAMED[pattern] for pattern in NAMED if fnmatchcase(name, pattern)), None)
        if kind and unit != units.get(kind, kind):
            return False
    return True


def test_measures_select_by_parameters_or_by_names(results):
    found = matching(results, "7.1", {"element": "pw-T6", "squares": 1})
    (named,) = matching(results, "7.1", "pw-T6")
    assert named.case in [one.case for one in found]
    assert like(results, named, element="galerkin-T6").case == "galerkin-T6"
    (recorded,) = matching(
        results, "C", {"element": "pw-T10", "problem": "statics", "setting": "ball"}
    )
    assert like(results, recorded, element="galerkin-T10").case == "galerkin-T10-ball"
    by_name = largest(results, "7.1", "pw-T6.*", "sum")
    assert largest(results, "7.1", {"element": "pw-T6"}, "sum") == by_name == pytest.approx(6)


TEXTS = sorted(Path(texts.__file__).parent.glob("*.[hm][td]*"))
TEXTS += [find_page_source(section) for section in SECTIONS]
LITERAL = re.compile(rf'"((?:{"|".join(map(re.escape, SECTIONS))})/[^"{{}}]*)"( *~)?')


@pytest.mark.parametrize("name", scripts())
def test_figures_need_cases(name):
    assert set(load_script(name).needs) <= set(CASES)


def _read_text(path):
    """Return a text in HTML, or all texts of a page."""
    if path.suffix != ".py":
        return path.read_text(encoding="utf-8")
    constants = read_constants(path)
    return "\n".join(constants.get(name, "") for name in ("MACROS", *BLOCKS))


@pytest.mark.parametrize("text", TEXTS, ids=lambda path: path.stem)
def test_texts_show_cases_and_figures(text):
    content = _read_text(text)
    assert set(re.findall(r'figure\("(\w+)"\)', content)) <= set(scripts())
    for key, beginning in LITERAL.findall(content):
        assert key in CASES or (beginning and any(case.startswith(key) for case in CASES)), key


@pytest.mark.parametrize("claim", load_claims(), ids=lambda claim: claim.id)
def test_claims_measure_cases(claim):
    args = claim.judgement.args if claim.judgement else {}
    named = [value for value in args.values() if isinstance(value, str) and "/" in value]
    assert set(named) <= set(CASES)
    if {"section", "cases"} <= set(args):
        section = [case for case in CASES.values() if case.section == args["section"]]
        assert any(_selects(args["cases"], case) for case in section)


def _selects(cases, case):
    if isinstance(cases, str):
        return re.fullmatch(cases, case.name)
    return StoredResult(case.section, case.name, case.stored_parameters, {}, {}, dict, {}).has(
        **cases
    )
