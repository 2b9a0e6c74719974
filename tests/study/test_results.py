"""What every result states, with suitable units; figures, claims and texts ask for known cases."""

import re
from fnmatch import fnmatchcase
from pathlib import Path

import pytest

from figures.drawing import load_script, scripts
from study.judge.claims import load_claims
from study.judge.measures.general import largest
from study.judge.measures.stored_cases import like, matching
from study.model.units import KN_M, N_MM, NONE, SI, UNSTATED
from study.model.vocabulary import ELEMENTS
from study.publish import texts
from study.run.cases import SECTIONS, load_section
from study.run.store import Stored
from tests.study.computed_results import listed

CASES = {case.key: case for section in SECTIONS for case in load_section(section).cases}
# Of each problem, a case that takes no longer than a second or so; the scans of 7.6 take longer
QUICK = [
    f"{section}/{name}"
    for section, name in listed("""
I: factors-galerkin-T6 dip-galerkin-T6
3: matrices weights
5: element-pw-Q9 identity statics-pw-Q9
7.1: galerkin-T6-nu0
7.2: pw-T6
7.3: galerkin-T6-mu0
7.4: galerkin-Q8
7.5: pw-T6 galerkin-Q8-SI
7.6: galerkin-Q8 exact
C: pwsym-T6-modes-square galerkin-T6-nu-plane-strain galerkin-Q8-plane-stress pw-T10-ball
P: block-even beam-16x4-mode2 block-native buckling-CPE6 two-triangles
T: composite-mass order-pw-T10 point-load statics-2d statics-3d
V1: pw-Q8-straight
V2: line-pw-T6 sphere-pw-T6 line-pw-Q8
V3: bonded-exact bonded-composite-T6-graded
V4: pw-T6-nu0.25-20.0deg-64 pw-Q8-nu0.25-20.0deg-64
V5: pw-T6-40 pw-Q8-40
V6: pw-T6-64 pw-Q8-64
V7: pw-T6-limit composite-T6-mu0.0-16x4
V8: cylinder-galerkin-Q8 free-plane-stress-galerkin-Q8 quadrature-galerkin-T6 rod-pw-T6
V8: square-pw-T6 strip-pw-T6 tube-pw-T6
V9: pw-lumped
V10: patch-pw-T10 tilted-sibling-T10 sphere-pw-T10-5 punch-galerkin-T10-2
V10: mindlin-pw-T10-8
V11: patch-3d-pw-dual overhang-2d-p2-dual hertz-2d-pw-dual-16 cattaneo-pw-dual-8 unequal-pw-dual-16
V11: r0094-pw-dual patch-3d-calculix-mortar spheres-pw-dual-5-ratio1.37
V12: bar-2d-sibling-16 frequency-square-hrz step-cube-sibling bar-3d-sibling-14
V13: square-pw-32 cube-transferred-4 graded-pw-16 sourced-standard-16 sourced-trefftz-6
V13: cube-pw-24
V14: punch-pw-T6-16 smooth-pw-T6-4 linear-pw-T6-8 punch-pw-T10-8
K: contact-pw-T10-8-Iterative contact-C3D10-8-CalculiX
V15: square-pw-hybrid-T6-0.5-8 cook-pw-hybrid-T6-32
V15: hertz-pw-hybrid-T6-32 identity-pw-hybrid-T6 infsup-pw-hybrid-T6-8 layers-pw-hybrid-Q9
V15: presses-pw-hybrid-T6-32
V15: cube-pw-hybrid-H27-0.4999-12
V16: shear-pw-T10 steps-pw-T6-1-1 compression-pw-T6
V16: calculix-pw-T6-cylinder-8-0.0 cylinder-pw-T6-16-68
V17: turned-pw-T6-90 fit-pw-hybrid-T6 die-galerkin-T6-finer
Q: pw-T6-4-0.375 calculix-4-0.375 seconds-pw-T6-16
W: wear-pw-T6-4-own friction-pw-T6-4-own conductance-pw-T6-4-own impact-sibling-T6-4-none
W: submodel-pw-T6-4-own wear-pw-T10-8-own
""")
]
LONG = [
    f"{section}/{name}"
    for section, name in listed("""
V10: mindlin-pw-T10-2
V11: spheres-pw-dual-3
V15: seal-pw-hybrid-T6-8 sphere-pw-hybrid-T10-3
V16: sphere-galerkin-T10-6 wheel-pw-hybrid-T6-4 bush-pw-T6
V16: cylinder-pw-T6-8 energy-pw-T6-4 hertz-pw-T6-4
V17: rings-pw-T6 die-pw-T6-coarser calculix-pw-T6-die-8-6 ironed-pw-T6
Q: offsets-pw-T6
""")
]
SLOW = {("7.6", "mesh_scan")}

SYSTEMS = {
    "7.4": KN_M,
    "7.5": KN_M,
    "7.6": SI,
    "V2": N_MM,
    "V6": SI,
    "V7": SI,
    "V8": NONE,
    "V17": NONE,
    "Q": NONE,
    "W": NONE,
}
SYSTEMS |= dict.fromkeys(("V4", "V5", *(f"V{n}" for n in range(9, 17))), NONE)
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
            assert stated["problem"] in ("exact", "trefftz") or stated["method"], case.key


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

    assert problems(CASES[key] for key in QUICK + LONG) == problems(CASES.values()) - SLOW


@pytest.mark.parametrize("key", QUICK + [pytest.param(k, marks=pytest.mark.slow) for k in LONG])
def test_every_number_has_a_suitable_unit(key, results):
    case, read = CASES[key], results[key]
    assert read.parameters == case.stored_parameters
    assert set(read.units) == set(read.scalars)
    units = SYSTEMS.get(case.section, UNSTATED)
    known = {*vars(units).values(), "1"} | {
        "7.5": {"1000/s²", "1/s²"},
        "P": {"Pa"},
        "K": {"s", "MB"},
        "Q": {"s"},
    }.get(case.section, set())
    assert set(read.units.values()) <= known
    for name, unit in read.units.items():
        kind = next((NAMED[pattern] for pattern in NAMED if fnmatchcase(name, pattern)), None)
        if kind:
            assert unit == vars(units).get(kind, kind), name


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


TEXTS = sorted(Path(texts.__file__).parent.glob("*.html"))
LITERAL = re.compile(rf'"((?:{"|".join(map(re.escape, SECTIONS))})/[^"]*)"( *~)?')


@pytest.mark.parametrize("name", scripts())
def test_figures_need_cases(name):
    assert set(load_script(name).needs) <= set(CASES)


@pytest.mark.parametrize("text", TEXTS, ids=lambda path: path.stem)
def test_texts_show_cases_and_figures(text):
    content = text.read_text()
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
    return Stored(case.section, case.name, case.stored_parameters, {}, {}, dict, {}).has(**cases)
