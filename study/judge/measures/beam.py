"""Measures of section 7.6."""

import numpy as np

from study.core.store import MissingResult, Results
from study.judge.measures.stored_cases import T6, of_section
from study.paper.items import TABLE_2


def printed(results: Results, element: str, mode: int) -> float:
    """A critical stress of Table 2 as printed."""
    return TABLE_2[element][mode - 1]


def euler_difference(results: Results, element: str, mode: int) -> float:
    """How far a printed critical stress lies below Euler's printed one, in per cent of it."""
    euler = TABLE_2["Euler"][mode - 1]
    return 100 * (euler - TABLE_2[element][mode - 1]) / euler


def printed_over_exact(results: Results, element: str, mode: int, reference: str) -> float:
    """Relative distance of a printed critical stress from an exact one, in per cent."""
    exact = results.scalar("7.6/exact", f"{reference}_{mode}")
    return 100 * (TABLE_2[element][mode - 1] / exact - 1)


def computed_over_printed(results: Results, case: str, element: str, mode: int) -> float:
    """Relative distance of a computed critical stress from a printed one, in per cent."""
    computed = results.scalar(f"7.6/{case}", f"sigma_cr_{mode}")
    return 100 * (computed / TABLE_2[element][mode - 1] - 1)


def computed_ratio(results: Results, case: str, over: str, mode: int) -> float:
    """Relative distance of two computed critical stresses, in per cent."""
    name = f"sigma_cr_{mode}"
    return 100 * (results.scalar(f"7.6/{case}", name) / results.scalar(f"7.6/{over}", name) - 1)


def printed_ratio(results: Results, element: str, over: str, mode: int) -> float:
    """Relative distance of two printed critical stresses, in per cent."""
    return 100 * (TABLE_2[element][mode - 1] / TABLE_2[over][mode - 1] - 1)


def exact_ratio(results: Results, name: str, over: str, mode: int) -> float:
    """Relative distance of two reference values, in per cent."""
    value = results.scalar("7.6/exact", f"{name}_{mode}")
    return 100 * (value / results.scalar("7.6/exact", f"{over}_{mode}") - 1)


def uniform_meshes(results: Results, case: str) -> list[tuple[int, int]]:
    """Divisions of the uniform-load cases of an element, coarse to fine."""
    start = f"{case}-uniform-"
    found = [
        s.case.removeprefix(start) for s in of_section(results, "7.6") if s.case.startswith(start)
    ]
    return sorted((int(nx), int(ny)) for nx, ny in (name.split("x") for name in found))


def uniform_errors(results: Results, case: str, mode: int) -> list[float]:
    """Relative errors of the uniform-load cases, coarse to fine, against their own exact value."""
    reference = "J" if case.endswith("-J") else "G"
    exact = results.scalar("7.6/exact", f"{reference}_{mode}")
    return [
        results.scalar(f"7.6/{case}-uniform-{nx}x{ny}", f"sigma_cr_{mode}") / exact - 1
        for nx, ny in uniform_meshes(results, case)
    ]


def finest_error(results: Results, case: str) -> float:
    """Larger of both modes' relative errors on the finest uniform-load mesh, in per cent."""
    return 100 * max(abs(uniform_errors(results, case, mode)[-1]) for mode in (1, 2))


def finest_squares(results: Results, case: str) -> float:
    """Squares over the beam's height on the finest uniform-load mesh."""
    return float(uniform_meshes(results, case)[-1][1])


def signed_error(results: Results, case: str, mode: int) -> float:
    """Relative error of a mode on the finest uniform-load mesh with its sign, in per cent."""
    return 100 * uniform_errors(results, case, mode)[-1]


def order(results: Results, case: str, mode: int) -> float:
    """Observed order in the element size between the two finest uniform-load meshes."""
    coarse, fine = uniform_errors(results, case, mode)[-2:]
    return float(np.log2(abs(coarse / fine)))


def pw_against_galerkin(results: Results, form: str) -> float:
    """Largest relative difference of pw-T6 and galerkin-T6 under uniform load, all meshes."""
    suffix = "-J" if form == "J" else ""
    return max(
        abs(a - b)
        for mode in (1, 2)
        for a, b in zip(
            *(uniform_errors(results, f"{element}{suffix}", mode) for element in T6), strict=True
        )
    )


def largest_imaginary(results: Results) -> float:
    """Largest |Im| over |Re| of all computed buckling factors."""
    values = [
        stored.scalars[f"imaginary_{mode}"]
        for stored in of_section(results, "7.6")
        if "imaginary_1" in stored.scalars
        for mode in (1, 2)
    ]
    return max(values)


def scan(results: Results, user_element: str) -> np.ndarray:
    """Deviations (m, 4) of all scanned models from Table 2 in per cent.

    Columns: CPS6 modes 1 and 2 by galerkin-T6 with J, user element modes 1 and 2 by
    `user_element` with G.
    """
    rows = []
    for stored in of_section(results, "7.6"):
        if stored.case.startswith("scan-"):
            cps6 = stored.curves["galerkin-T6-J"] / TABLE_2["CPS6"]
            user = stored.curves[f"{user_element}-G"] / TABLE_2["6-node user element"]
            rows.append(np.hstack([cps6, user]))
    if not rows:
        raise MissingResult("no mesh has been scanned: run ./run study 7.6")
    return 100 * (np.concatenate(rows) - 1)


def scan_best_model(results: Results, user_element: str) -> int:
    """Row of the scanned model whose largest deviation from Table 2 is smallest."""
    return int(np.nanargmin(np.abs(scan(results, user_element)).max(axis=1)))


def scan_best(results: Results, user_element: str) -> float:
    """The largest deviation of that model from Table 2, in per cent."""
    row = scan_best_model(results, user_element)
    return float(np.abs(scan(results, user_element)[row]).max())


def scan_count(results: Results) -> float:
    """Number of scanned models."""
    return float(len(scan(results, "pw-T6")))


def scan_indefinite(results: Results) -> float:
    """Number of scanned models whose symmetrised stiffness is indefinite."""
    return float(np.isnan(scan(results, "pwsym-T6")).any(axis=1).sum())
