"""Test parameters and units of results, and that figures, claims and texts use existing cases."""

import re
from fnmatch import fnmatchcase
from pathlib import Path

import pytest

from figures.drawing import list_names_of_all_figures, load_figure_script
from study.judge.claims import load_claims
from study.judge.measures.general import largest
from study.judge.measures.stored_cases import find_result_with_changed_parameters, select_results
from study.model.units import DIMENSIONLESS_UNITS, KN_M_UNITS, N_MM_UNITS, SI_UNITS, UNSTATED_UNITS
from study.model.vocabulary import ELEMENTS
from study.publish import texts
from study.publish.texts import BLOCK_OF_CONSTANT
from study.run.cases import SECTIONS, find_page_source, load_section
from study.run.expected import read_table_of_expected_seconds
from study.run.pages import read_literal_constants
from study.run.store import StoredResult

CASES_BY_KEY = {case.key: case for section in SECTIONS for case in load_section(section).cases}


def find_quickest_case_key_of_each_problem():
    """Return, for each problem, the key of the computed case with the shortest expected time."""
    by_problem = {}
    for key, case in CASES_BY_KEY.items():
        if not case.record:
            by_problem.setdefault((case.section, case.run.__name__), []).append(key)
    seconds = read_table_of_expected_seconds()
    return [min(keys, key=lambda key: seconds.get(key, 0.0)) for keys in by_problem.values()]


QUICKEST_CASE_KEYS_WITH_MARKS = [
    pytest.param(
        key, marks=[pytest.mark.slow] * (read_table_of_expected_seconds().get(key, 0.0) > 3.0)
    )
    for key in find_quickest_case_key_of_each_problem()
]
UNIT_SYSTEMS = (UNSTATED_UNITS, DIMENSIONLESS_UNITS, N_MM_UNITS, KN_M_UNITS, SI_UNITS)
UNITS_ALLOWED_IN_EVERY_SYSTEM = {"1", "%", "s", "MB", "1/s²", "1000/s²", "Pa"}
# Kinds of scalars by patterns of their names, in all sections; the first match counts
SCALAR_NAME_PATTERNS_BY_KIND = {
    "1": "error* smallest_* *_error order* *difference* *residual* iterations* imaginary* ratio* "
    "sawtooth* peak_over_mean*",
    "force": "*force* reaction_*",
    "stress": "peak_pressure* mean_pressure sigma_cr_*",
    "length": "closed_* stick_from* translation *radius*",
}
KIND_BY_SCALAR_NAME_PATTERN = {
    pattern: kind
    for kind, patterns in SCALAR_NAME_PATTERNS_BY_KIND.items()
    for pattern in patterns.split()
}


def is_element_of_this_study(name):
    """Return whether a name denotes an element of this study, not one of CalculiX or "exact".

    Section E has elements of the degrees 1 to 5 for comparison.
    """
    is_of_other_degree = re.fullmatch(r"(pw|galerkin)-P[1-5]", name) is not None
    return (name in ELEMENTS and name != "exact") or is_of_other_degree


@pytest.mark.parametrize("section", SECTIONS)
def test_every_case_states_its_element_compared_elements_or_method(section):
    cases = [case for case in CASES_BY_KEY.values() if case.section == section]
    for case in cases:
        parameters = case.stored_parameters
        assert parameters["problem"], case.key
        assert {*case.parameters, *case.implied_parameters} <= set(parameters), case.key
        if "element" in parameters:
            assert is_element_of_this_study(parameters["element"]), case.key
        elif "compared" in parameters:
            assert parameters["compared"], case.key
            assert all(map(is_element_of_this_study, parameters["compared"])), case.key
        elif "peer_element" in parameters:
            assert not is_element_of_this_study(parameters["peer_element"]), case.key
        else:
            assert (
                parameters["problem"] in ("exact", "trefftz", "reference") or parameters["method"]
            ), case.key


@pytest.mark.parametrize("section", SECTIONS)
def test_parameters_distinguish_cases(section):
    parameters_by_case = [
        case.stored_parameters for case in CASES_BY_KEY.values() if case.section == section
    ]
    assert all(parameters_by_case.count(parameters) == 1 for parameters in parameters_by_case)


def test_element_in_a_case_name_is_that_of_its_parameters():
    for key, case in CASES_BY_KEY.items():
        element = case.stored_parameters.get("element")
        elements_in_name = [name for name in ELEMENTS if f"-{name}-" in f"-{case.name}-"]
        if element and elements_in_name:
            assert elements_in_name == [element], key


@pytest.mark.parametrize("key", QUICKEST_CASE_KEYS_WITH_MARKS)
def test_units_of_scalars_fit_their_names_in_one_unit_system(key, results):
    case, stored_result = CASES_BY_KEY[key], results[key]
    assert stored_result.parameters == case.stored_parameters
    assert set(stored_result.units) == set(stored_result.scalars)
    suitable_systems = [
        units
        for units in map(vars, UNIT_SYSTEMS)
        if set(stored_result.units.values()) <= {*units.values()} | UNITS_ALLOWED_IN_EVERY_SYSTEM
        and _units_suit_scalar_names(stored_result, units)
    ]
    assert suitable_systems, stored_result.units


def _units_suit_scalar_names(result, units):
    """Return whether scalars whose names imply a kind of quantity have the unit of this kind."""
    for name, unit in result.units.items():
        kind = next(
            (
                KIND_BY_SCALAR_NAME_PATTERN[pattern]
                for pattern in KIND_BY_SCALAR_NAME_PATTERN
                if fnmatchcase(name, pattern)
            ),
            None,
        )
        if kind and unit != units.get(kind, kind):
            return False
    return True


def test_measures_select_by_parameters_or_by_names(results):
    selected_results = select_results(results, "7.1", {"element": "pw-T6", "squares": 1})
    (result_by_name,) = select_results(results, "7.1", "pw-T6")
    assert result_by_name.case in [selected_result.case for selected_result in selected_results]
    assert (
        find_result_with_changed_parameters(results, result_by_name, element="galerkin-T6").case
        == "galerkin-T6"
    )
    (recorded_result,) = select_results(
        results, "C", {"element": "pw-T10", "problem": "statics", "setting": "ball"}
    )
    assert (
        find_result_with_changed_parameters(results, recorded_result, element="galerkin-T10").case
        == "galerkin-T10-ball"
    )
    largest_by_name = largest(results, "7.1", "pw-T6.*", "sum")
    assert (
        largest(results, "7.1", {"element": "pw-T6"}, "sum") == largest_by_name == pytest.approx(6)
    )


TEXT_AND_PAGE_FILES = sorted(Path(texts.__file__).parent.glob("*.[hm][td]*"))
TEXT_AND_PAGE_FILES += [find_page_source(section) for section in SECTIONS]
CASE_KEY_PATTERN = re.compile(rf'"((?:{"|".join(map(re.escape, SECTIONS))})/[^"{{}}]*)"( *~)?')


@pytest.mark.parametrize("name", list_names_of_all_figures())
def test_figures_need_existing_cases_only(name):
    assert set(load_figure_script(name).needs) <= set(CASES_BY_KEY)


def _read_html_or_page_texts(path):
    """Return the content of a text file, or all text constants of a section's Python page."""
    if path.suffix != ".py":
        return path.read_text(encoding="utf-8")
    constants = read_literal_constants(path)
    return "\n".join(constants.get(name, "") for name in ("MACROS", *BLOCK_OF_CONSTANT))


@pytest.mark.parametrize("path", TEXT_AND_PAGE_FILES, ids=lambda path: path.stem)
def test_texts_refer_to_existing_cases_and_figures_only(path):
    content = _read_html_or_page_texts(path)
    assert set(re.findall(r'figure\("(\w+)"\)', content)) <= set(list_names_of_all_figures())
    for key, is_beginning in CASE_KEY_PATTERN.findall(content):
        assert key in CASES_BY_KEY or (
            is_beginning and any(case.startswith(key) for case in CASES_BY_KEY)
        ), key


@pytest.mark.parametrize("claim", load_claims(), ids=lambda claim: claim.id)
def test_claims_measure_existing_cases_only(claim):
    args = claim.judgement.args if claim.judgement else {}
    named_keys = [value for value in args.values() if isinstance(value, str) and "/" in value]
    assert set(named_keys) <= set(CASES_BY_KEY)
    if {"section", "cases"} <= set(args):
        section_cases = [case for case in CASES_BY_KEY.values() if case.section == args["section"]]
        assert any(_is_selected(args["cases"], case) for case in section_cases)


def _is_selected(selection, case):
    if isinstance(selection, str):
        return re.fullmatch(selection, case.name)
    return StoredResult(case.section, case.name, case.stored_parameters, {}, {}, dict, {}).has(
        **selection
    )
