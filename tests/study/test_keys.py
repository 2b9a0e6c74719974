"""Every result that figures, claims and texts of the report ask for is a case of the study."""

import re
from importlib import import_module
from pathlib import Path

import pytest

from figures.__main__ import scripts
from study import texts
from study.core.cases import SECTIONS, load_section
from study.core.store import Stored
from study.judge.claims import load_claims

LOADED = {name: load_section(name).cases for name in SECTIONS}
CASES = {name: [case.name for case in cases] for name, cases in LOADED.items()}
KEYS = {f"{section}/{case}" for section, cases in CASES.items() for case in cases}
TEXTS = sorted(Path(texts.__file__).parent.glob("*.html"))
LITERAL = re.compile(rf'"((?:{"|".join(map(re.escape, SECTIONS))})/[^"]*)"( *~)?')


@pytest.mark.parametrize("name", scripts())
def test_figures_need_cases(name):
    assert set(import_module(f"figures.{name}").NEEDS) <= KEYS


@pytest.mark.parametrize("text", TEXTS, ids=lambda path: path.stem)
def test_texts_show_cases_and_figures(text):
    content = text.read_text()
    assert set(re.findall(r'figure\("(\w+)"\)', content)) <= set(scripts())
    for key, beginning in LITERAL.findall(content):
        assert key in KEYS or (beginning and any(case.startswith(key) for case in KEYS)), key


@pytest.mark.parametrize("claim", load_claims(), ids=lambda claim: claim.id)
def test_claims_measure_cases(claim):
    args = claim.judgement.args if claim.judgement else {}
    named = [value for value in args.values() if isinstance(value, str) and "/" in value]
    assert set(named) <= KEYS
    if {"section", "cases"} <= set(args):
        assert any(_selects(args["cases"], case) for case in LOADED[args["section"]])


def _selects(cases, case):
    if isinstance(cases, str):
        return re.fullmatch(cases, case.name)
    return Stored(case.section, case.name, case.stored_parameters, {}, {}, {}, {}).has(**cases)
