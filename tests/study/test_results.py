"""What every result states: its parameters, and a unit that suits each number."""

from fnmatch import fnmatchcase

import pytest

from study.core.cases import SECTIONS, load_section
from study.core.store import Results, save
from study.judge.measures.general import largest
from study.judge.measures.stored_cases import like, matching
from study.units import KN_M, N_MM, NONE, SI, UNSTATED, units_of
from study.vocabulary import ELEMENTS

CASES = {case.key: case for section in SECTIONS for case in load_section(section).cases}
# Of each problem, a case that takes no longer than a second or so; the scans of 7.6 take longer
QUICK = [
    "I/factors-galerkin-T6",
    "I/dip-galerkin-T6",
    "3/matrices",
    "3/weights",
    "5/element-pw-Q9",
    "5/identity",
    "5/statics-pw-Q9",
    "7.1/galerkin-T6-nu0",
    "7.2/pw-T6-stick",
    "7.3/galerkin-T6-mu0",
    "7.4/galerkin-Q8-mu0",
    "7.5/pw-T6-gaps0.0-0.0",
    "7.5/galerkin-Q8-SI",
    "7.6/galerkin-Q8",
    "7.6/exact",
    "C/galerkin-Q8-modes-square",
    "C/galerkin-T6-nu-plane-strain",
    "C/galerkin-Q8-plane-stress",
    "P/block-even",
    "P/beam-16x4-mode2",
    "P/block-native",
    "P/buckling-CPE6",
    "P/two-triangles",
    "T/composite-mass",
    "T/order-pw-T10",
    "T/point-load",
    "T/statics-2d",
    "T/statics-3d",
    "V1/pw-Q8-straight",
    "V2/line-composite-T6",
    "V2/sphere-galerkin-T6",
    "V3/bonded-exact",
    "V3/bonded-composite-T6-graded",
    "V4/galerkin-Q8-nu0.25-20.0deg-16",
    "V5/galerkin-T6-10",
    "V6/composite-T6-16",
    "V7/pw-T6-limit",
    "V7/composite-T6-mu0.0-16x4",
    "V8/cylinder-galerkin-Q8",
    "V8/free-plane-stress-galerkin-Q8",
    "V8/quadrature-galerkin-T6",
    "V8/rod-galerkin-Q8",
    "V8/square-pwsym-T6",
    "V8/strip-pw-Q9-nine",
    "V8/tube-galerkin-Q8",
    "V9/pw-consistent-2",
    "V10/patch-pw-H27",
    "V10/tilted-sibling-T10",
    "V10/sphere-transferred-T10-3",
    "V10/punch-galerkin-T10-2",
    "V10/mindlin-pw-T10-2",
    "V10/mindlin-pw-T10-8",
    "V11/patch-3d-pw-dual",
    "V11/overhang-2d-p2-dual",
    "V11/hertz-2d-p2-p1-4",
    "V11/cattaneo-pw-dual-8",
    "V11/unequal-pw-dual-8",
    "V11/r0094-node-to-segment",
    "V11/spheres-pw-dual-3",
    "V11/patch-3d-calculix-mortar",
    "V12/bar-2d-sibling-4",
    "V12/frequency-square-hrz",
    "V12/step-cube-sibling",
    "V12/bar-3d-sibling-14",
    "V13/square-own-8",
    "V13/cube-transferred-4",
    "V13/graded-pw-16",
    "V13/sourced-standard-16",
    "V13/sourced-trefftz-6",
    "V13/cube-pw-24",
    "V14/punch-pw-T6-4",
    "V14/punch-pw-T10-2",
    "V14/smooth-pw-T6-4",
    "V14/linear-pw-T6-8",
    "V14/punch-pw-T10-8",
    "K/contact-pw-T10-8-Iterative",
    "K/contact-C3D10-8-CalculiX",
    "V15/square-pw-hybrid-T6-0.5-8",
    "V15/cube-pw-hybrid-T10-0.4999-3",
    "V15/cook-galerkin-hybrid-T6-4",
    "V15/hertz-pw-T6-8",
    "V15/identity-pw-hybrid-T6",
    "V15/infsup-pw-hybrid-T10-2",
    "V15/layers-pw-hybrid-Q9",
    "V15/presses-pw-hybrid-T6-8",
    "V15/pushed-pw-hybrid-T6-30",
    "V15/sphere-pw-hybrid-H27-3",
    "V15/seal-pw-hybrid-T6-8",
    "V15/enclosed-pw-hybrid-H27-0.4999-4",
    "V15/cube-pw-hybrid-H27-0.4999-12",
    "V16/cylinder-pw-T6-8",
    "V16/energy-galerkin-T6-4",
    "V16/sphere-galerkin-T10-6",
    "V16/shear-pw-T10",
    "V16/hertz-pw-T6-4",
]
SLOW = {("7.6", "mesh_scan")}

SYSTEMS = {
    "7.4": KN_M,
    "7.5": KN_M,
    "7.6": SI,
    "V2": N_MM,
    "V4": NONE,
    "V5": NONE,
    "V6": SI,
    "V7": SI,
    "V8": NONE,
    "V9": NONE,
    "V10": NONE,
    "V11": NONE,
    "V12": NONE,
    "V13": NONE,
    "V14": NONE,
    "V15": NONE,
    "V16": NONE,
}
# What names say, whatever the section; the first pattern counts
NAMED = {
    "error*": "1",
    "smallest_*": "1",
    "*_error": "1",
    "order*": "1",
    "*difference*": "1",
    "*residual*": "1",
    "iterations*": "1",
    "imaginary*": "1",
    "ratio*": "1",
    "sawtooth*": "1",
    "peak_over_mean*": "1",
    "*force*": "force",
    "reaction_*": "force",
    "peak_pressure*": "stress",
    "mean_pressure": "stress",
    "sigma_cr_*": "stress",
    "closed_*": "length",
    "stick_from*": "length",
    "translation": "length",
    "*radius*": "length",
}


def is_element(name):
    """Whether it is one of ours; those of CalculiX have another parameter."""
    return name in ELEMENTS and name != "exact"


@pytest.mark.parametrize("section", SECTIONS)
def test_every_case_states_its_element_where_it_has_one(section):
    cases = [case for case in CASES.values() if case.section == section]
    for case in cases:
        stated = case.stored_parameters
        assert stated["problem"], case.key
        assert {*case.parameters, *case.implied} < set(stated), case.key
        if "element" in stated:
            assert is_element(stated["element"]), case.key
        elif "compared" in stated:
            assert stated["compared"], case.key
            assert all(map(is_element, stated["compared"])), case.key
        elif "peer_element" in stated:
            assert not is_element(stated["peer_element"]), case.key
        else:
            assert stated["problem"] in ("exact", "trefftz"), case.key


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


def test_quick_cases_are_of_all_problems():
    def problems(cases):
        return {(case.section, case.run.__name__) for case in cases}

    assert problems(CASES[key] for key in QUICK) == problems(CASES.values()) - SLOW


@pytest.mark.parametrize("key", QUICK)
def test_every_number_has_a_suitable_unit(key, tmp_path):
    case = CASES[key]
    result = case.run(**case.parameters)
    save(tmp_path, case.section, case.name, result, case.stored_parameters, {})
    read = Results(tmp_path)[key]
    assert read.parameters == case.stored_parameters
    assert set(read.units) == set(read.scalars)
    units = SYSTEMS.get(case.section, UNSTATED)
    known = {*vars(units).values(), "1"} | {
        "7.5": {"1000/s²", "1/s²"},
        "P": {"Pa"},
        "K": {"s", "MB"},
    }.get(case.section, set())
    assert set(read.units.values()) <= known
    for name, unit in read.units.items():
        kind = next((NAMED[pattern] for pattern in NAMED if fnmatchcase(name, pattern)), None)
        if kind:
            assert unit == vars(units).get(kind, kind), name


@pytest.mark.parametrize(
    ("key", "modulus", "unit"),
    [("7.5/pwsym-Q8", 2.1e8, "1000/s²"), ("7.5/galerkin-Q8-SI", 2.1e11, "1/s²")],
)
def test_eigenvalues_of_the_column_are_in_the_units_of_its_modulus(key, modulus, unit):
    case = CASES[key]
    assert case.stored_parameters["youngs_modulus"] == modulus
    assert case.run(**case.parameters).units["omega2_1"] == unit


def test_scalar_that_no_pattern_knows_gets_no_unit():
    kinds = {"force_*": "force", "*_x": "length", "omega2": "1/s²"}
    assert units_of(["force_x", "place_x", "omega2", "odd"], kinds, SI) == {
        "force_x": "N",
        "place_x": "m",
        "omega2": "1/s²",
    }


@pytest.fixture
def stored(tmp_path):
    for key in ("7.1/pw-T6", "7.1/galerkin-T6", "7.1/pw-T6-row"):
        case = CASES[key]
        result = case.run(**case.parameters)
        save(tmp_path, case.section, case.name, result, case.stored_parameters, {})
    return Results(tmp_path)


def test_measures_select_by_parameters_or_by_names(stored):
    by_parameters = matching(stored, "7.1", {"element": "pw-T6", "squares": 1})
    assert [one.case for one in by_parameters] == ["pw-T6"]
    assert matching(stored, "7.1", "pw-T6") == by_parameters
    assert like(stored, by_parameters[0], element="galerkin-T6").case == "galerkin-T6"
    by_name = largest(stored, "7.1", "pw-T6.*", "sum")
    assert largest(stored, "7.1", {"element": "pw-T6"}, "sum") == by_name == pytest.approx(6)
