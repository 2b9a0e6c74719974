"""The report's appendix: what sections were computed with, as results and code say."""

import sys
from importlib import import_module

import pytest

from study.publish.texts import appendix
from study.run.store import Result, Results, save


@pytest.fixture
def one(tmp_path):
    """A function that stores a case of V1 and returns what the section was computed with."""

    def computed(parameters, dofs=None, curves=None, record=""):
        name = f"case-{len(list(tmp_path.rglob('*.json')))}"
        provenance = {"record": record} | ({} if dofs is None else {"dofs": dofs})
        result = Result({"y": 1.0}, {"y": "1"}, curves or {})
        save(tmp_path, "V1", name, result, {"element": "pw-T6"} | parameters, provenance)
        return appendix.computed(Results(tmp_path), "V1")

    return computed


def test_unknowns_are_the_fewest_and_the_most_and_mesh_sizes_are_listed_once(one):
    one({"divisions": [80, 40]}, dofs=40)
    one({"dofs": 900, "divisions": [20, 10]})  # a recorded case keeps them among its parameters
    assert one({"divisions": [20, 10]}, dofs=120)[:4] == (3, 0, (40, 900), ["20 × 10", "80 × 40"])
    assert one({"measured": {}}, dofs=120, record="study/run/records.json")[:2] == (4, 1)


def test_results_that_were_computed_and_that_were_read_are_counted(one, tmp_path):
    one({}, dofs=1)
    one({}, dofs=1)
    one({}, dofs=1, record="study/run/records.json")
    assert appendix.computed_and_recorded(Results(tmp_path)) == (2, 1)


@pytest.mark.parametrize(
    ("parameters", "curves", "meshes"),
    [
        ({"squares": [8, 2, 4]}, {}, ["2", "4", "8"]),
        ({"elements": 5}, {}, ["5"]),
        ({"sides": [0.25, 0.35]}, {}, ["2.86", "4"]),
        ({}, {"elements": [4.0, 8.0, 16.0]}, ["4", "8", "16"]),
        ({"friction": 0.3}, {"x": [1.0, 2.0]}, []),
    ],
)
def test_mesh_sizes_come_from_parameters_and_series(one, parameters, curves, meshes):
    assert one(parameters, dofs=1, curves=curves).meshes == meshes


@pytest.mark.parametrize(
    ("section", "module"),
    [
        ("V13", "study.benchmarks.v13_fluxes.page"),
        ("V14", "study.benchmarks.v14_rubber.page"),
        ("C", "study.benchmarks.c_convergence.statics"),
        ("V2", None),
    ],
)
def test_degrees_are_those_that_the_modules_use(section, module):
    degree = import_module(module).DEGREE if module else {}
    expected = {*degree.values()} if isinstance(degree, dict) else {degree}
    assert appendix._degrees(appendix.SECTIONS[section]) == expected


def test_the_librarys_degree_is_the_one_that_it_loads():
    import_module("pw_elements")
    loaded = [
        vars(module)["_NON_POLYNOMIAL_QUADRATURE_DEGREE"]
        for name, module in sys.modules.items()
        if name.startswith("pw_elements") and "_NON_POLYNOMIAL_QUADRATURE_DEGREE" in vars(module)
    ]
    assert loaded == [appendix.RATIONAL_DEGREE]
