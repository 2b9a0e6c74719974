"""Test that cases which serve to estimate a discretisation uncertainty differ only in meshes."""

import math
import re
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from study.judge.grid_convergence import MIN_REFINEMENT_RATIO
from study.judge.measures.uncertainty import error_over_index, observed_order
from study.judge.mesh_series import QUANTITIES, SeriesQuantity
from study.paper.s7_4_rigid_plate import (
    BODY_DEPTH,
    ELEMENTS_UNDER_HALF_PLATE,
    HALF_BODY_WIDTH,
    HALF_PLATE_WIDTH,
    PATTERN,
    _mesh_body_below_plate,
)
from study.publish.texts import TextRenderer
from study.run.cases import load_section
from study.run.store import Results

RESULTS_FOLDER = Path(__file__).parents[2] / "results"
MESH_PARAMETER_NAMES = ("divisions", "refined")
CASES_BY_KEY = {
    case.key: case
    for section in sorted({quantity.section for quantity in QUANTITIES})
    for case in load_section(section).cases
}
KEYS_AND_REFINEMENTS_OF_SERIES = sorted(
    {
        (keys, quantity.refinements)
        for quantity in QUANTITIES
        for keys in (quantity.new, quantity.standard)
    }
)
RECORD_PARAMETER_NAMES = ("measured", "units", "dofs")


def split_mesh_and_other_parameters(key):
    """Return the mesh parameters and all other parameters of a case as two dictionaries."""
    parameters = {
        name: value
        for name, value in CASES_BY_KEY[key].stored_parameters.items()
        if name not in RECORD_PARAMETER_NAMES
    }
    mesh = {name: parameters.pop(name) for name in MESH_PARAMETER_NAMES if name in parameters}
    if CASES_BY_KEY[key].section == "7.4":  # see the test of the plate's edges
        del parameters["pattern"]
    return mesh, parameters


@pytest.mark.parametrize(
    ("keys", "refinements"), KEYS_AND_REFINEMENTS_OF_SERIES, ids=lambda value: str(value[0])
)
def test_cases_of_a_series_differ_by_the_mesh_alone(keys, refinements):
    meshes, other_parameters = zip(*map(split_mesh_and_other_parameters, keys), strict=True)
    assert other_parameters[0] == other_parameters[1] == other_parameters[2]
    assert len(meshes[0]) == 1
    ((name, coarse),) = meshes[0].items()
    for mesh, refinement in zip(meshes, refinements, strict=True):
        if name == "divisions":
            assert mesh[name] == [n * refinement for n in coarse]
        else:
            assert mesh[name] == coarse * refinement
    ratios = [fine / coarse for coarse, fine in pairwise(refinements)]
    assert min(ratios) >= MIN_REFINEMENT_RATIO


@pytest.mark.parametrize("suffix", ["", "-mu0", "-strain"])
def test_refinement_preserves_the_triangle_counts_at_the_plate_edges(suffix):
    counts = [
        count_triangles_at_both_plate_edges(
            CASES_BY_KEY[f"7.4/pw-T6{suffix}{refinement}"].parameters
        )
        for refinement in ("", "-refined2", "-refined4")
    ]
    assert counts[0] == counts[1] == counts[2]
    turned_pattern_parameters = CASES_BY_KEY["7.4/pw-T6-mu0-refined2-turned"].parameters
    assert count_triangles_at_both_plate_edges(turned_pattern_parameters) != counts[0]


def count_triangles_at_both_plate_edges(parameters):
    """Return the numbers of triangles that meet at the left and at the right edge of the plate."""
    pattern, refined = parameters.get("pattern", PATTERN), parameters.get("refined", 1)
    mesh = _mesh_body_below_plate(
        ELEMENTS_UNDER_HALF_PLATE, HALF_BODY_WIDTH, BODY_DEPTH, pattern, refined, "triangle"
    )
    nodes, x = mesh.geometry.dofmap, mesh.geometry.x
    is_edge = [
        np.isclose(x[:, 0], side) & np.isclose(x[:, 1], 0)
        for side in (-HALF_PLATE_WIDTH, HALF_PLATE_WIDTH)
    ]
    return [int(mask[nodes].any(axis=1).sum()) for mask in is_edge]


def test_each_quantity_compares_new_and_standard_triangles_under_a_distinct_name():
    for quantity in QUANTITIES:
        new, standard = (
            CASES_BY_KEY[keys[0]].stored_parameters["element"]
            for keys in (quantity.new, quantity.standard)
        )
        assert (new.startswith("pw"), standard) == (True, "galerkin-T6")
    names = [(quantity.section, quantity.words) for quantity in QUANTITIES]
    assert len(set(names)) == len(names)


class PowerLawResults:
    """Results with scalars 1 + c h^2, where c is -1 for the standard element and otherwise 3."""

    def scalar(self, key, name):
        assert name == "force"
        element, n = key.split("-")
        return 1 + {"new": 3.0, "standard": -1.0, "turned": 3.0}[element] * float(n) ** -2.0

    def curves(self, key):
        return {"x": np.array([0.0, 2.0]), "pressure": 2 * np.full(2, self.scalar(key, "force"))}


NEW_ELEMENT_KEYS, STANDARD_ELEMENT_KEYS = (
    tuple(f"{element}-{n}" for n in (1, 2, 4)) for element in ("new", "standard")
)


@pytest.mark.parametrize(("name", "position", "limit"), [("force", None, 0.5), ("pressure", 1, 1)])
def test_a_quantity_is_estimated_from_scalars_or_curves_in_its_unit(name, position, limit):
    quantity = SeriesQuantity(
        "1", "force", name, NEW_ELEMENT_KEYS, STANDARD_ELEMENT_KEYS, (1, 2, 4), 2.0, position
    )
    new, standard = (
        quantity.estimate_convergence(PowerLawResults(), element) for element in ("new", "standard")
    )
    assert new.values[0] == pytest.approx(4 * limit)
    assert standard.values[0] == pytest.approx(0)
    for convergence in (new, standard):
        assert convergence.order == pytest.approx(2)
        assert convergence.extrapolated == pytest.approx(limit)


def test_an_exact_power_law_has_its_order_and_an_error_of_four_fifths_of_the_index():
    results = PowerLawResults()
    assert observed_order(results, NEW_ELEMENT_KEYS, "force", (1, 2, 4)) == pytest.approx(2)
    assert error_over_index(
        results, NEW_ELEMENT_KEYS, STANDARD_ELEMENT_KEYS, "force", (1, 2, 4)
    ) == pytest.approx(0.8)
    constant = ("new-1", "new-2", "new-2")
    assert math.isnan(observed_order(results, constant, "force", (1, 2, 4)))
    assert math.isnan(
        error_over_index(results, constant, STANDARD_ELEMENT_KEYS, "force", (1, 2, 4))
    )


@pytest.mark.skipif(
    not (RESULTS_FOLDER / "claims.json").exists(), reason="./run study makes results"
)
def test_table_of_uncertainties_has_a_row_for_each_quantity():
    results = Results(RESULTS_FOLDER)
    keys = {key for quantity in QUANTITIES for key in (*quantity.new, *quantity.standard)}
    if missing := sorted(key for key in keys if key not in results):
        pytest.skip(f"results are incomplete: {missing[0]}")
    renderer = TextRenderer(results, [], "", {}, strict=False)
    html = renderer.render_text("uncertainty")
    rows = re.findall(r"<tr>.*?</tr>", html, re.DOTALL)[1:]
    assert len(rows) == len(QUANTITIES)
    for row, quantity in zip(rows, QUANTITIES, strict=True):
        assert f">{quantity.section}</th>" in row
        n_estimates = sum(
            not quantity.estimate_convergence(results, element).reason
            for element in ("new", "standard")
        )
        assert row.count("not asymptotic") == 2 - n_estimates
    assert "not validation" in renderer.render_text("vocabulary")
