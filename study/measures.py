"""What the claims measure: functions of the stored results, each giving one number."""

import re
from collections.abc import Sequence

import numpy as np

from study.paper import TABLE_1, TABLE_2
from study.store import MissingResult, Results, Stored
from study.verification.friction import GRECO_PLACES, GRECO_PROTOTYPE, GRECO_PUBLISHED

T6 = ("galerkin-T6", "pw-T6")
OPEN, STICK = 0, 1  # contact status as the library numbers it


def scalar(results: Results, key: str, name: str) -> float:
    """A stored number as it is."""
    return results.scalar(key, name)


def _of_section(results: Results, section: str) -> list[Stored]:
    found = results.section(section)
    if not found:
        raise MissingResult(f"there are no results of section {section}: run ./run study {section}")
    return found


# 7.1


def middle_over_side(results: Results, element: str) -> float:
    """Reaction of the central node over the larger of the two others."""
    sides = [results.scalar(f"7.1/{element}", f"reaction_{i}") for i in (0, 2)]
    return results.scalar(f"7.1/{element}", "reaction_1") / max(sides)


def corner_over_midside(results: Results, element: str) -> float:
    """Smallest interior corner node's reaction over the largest mid-side one's, row of squares."""
    reactions = results.curves(f"7.1/{element}-row")["reaction"]
    return float(reactions[2:-2:2].min() / reactions[1::2].max())


def reaction_spread(results: Results, element: str) -> float:
    """Largest change of a reaction with material, stress state or diagonal."""
    reactions = np.array(
        [
            [stored.scalars[f"reaction_{i}"] for i in range(3)]
            for stored in _of_section(results, "7.1")
            if stored.case.startswith(element) and not stored.case.endswith("-row")
        ]
    )
    return float(np.ptp(reactions, axis=0).max())


# 7.2 to 7.4

BLOCK_PRESSURE = 200.0


def curve_at(results: Results, key: str, name: str, x: float) -> float:
    """A curve along the contact surface at x, linear between nodes."""
    curves = results.curves(key)
    return float(np.interp(x, curves["x"], curves[name]))


def edge_force_change(results: Results, key: str, other: str) -> float:
    """Change of the normal force at the right end of the contact line, in per cent."""
    ours, theirs = (results.curves(k)["force_n"][-1] for k in (key, other))
    return float(100 * (ours / theirs - 1))


def cells(results: Results, key: str) -> float:
    """Number of cells of the mesh."""
    return float(len(results.curves(key)["cells"]))


def slip_sawtooth(results: Results, key: str) -> float:
    """Median over slipping mid-side nodes of shear force over the mean of both corners'."""
    curves = results.curves(key)
    force, slipping = curves["force_t"], (curves["status"] == 2) & (curves["friction"] > 0)
    middle = np.arange(3, len(force) - 3, 2)
    used = middle[slipping[middle] & slipping[middle - 1] & slipping[middle + 1]]
    return float(np.median(2 * force[used] / (force[used - 1] + force[used + 1])))


def stress_difference(
    results: Results, key: str, other: str, low: float, high: float, name: str = "pressure"
) -> float:
    """Largest difference of two stress curves in low <= x <= high, in per cent of their mean."""
    a, b = results.curves(key), results.curves(other)
    x = a["x"][(a["x"] >= low - 1e-9) & (a["x"] <= high + 1e-9)]
    ours, theirs = (np.interp(x, c["x"], c[name]) for c in (a, b))
    return float(100 * np.abs(ours - theirs).max() / np.abs(theirs).mean())


def transfer_defect(results: Results, section: str, component: str, suffix: str = "") -> float:
    """T times the standard triangle's nodal forces against the new one's.

    Largest difference in per cent of the mean normal force of a closed node.
    """
    galerkin, pw = (results.curves(f"{section}/{element}{suffix}") for element in T6)
    mean = pw["force_n"][pw["status"] != 0].mean()
    return float(100 * np.abs(galerkin[f"{component}_T"] - pw[component]).max() / mean)


def displacement_change(results: Results, section: str) -> float:
    """Displacements of the new triangle against the standard one's, relative, in per cent."""
    galerkin, pw = (results.curves(f"{section}/{element}")["displacement"] for element in T6)
    return float(100 * np.linalg.norm(pw - galerkin) / np.linalg.norm(galerkin))


def node_choice(results: Results, element: str) -> float:
    """Change of the mean tangential displacement by making the shared nodes smooth, per cent."""
    rough, smooth = (
        results.curves(f"7.2/{element}{suffix}")["displacement"][:, 0].mean()
        for suffix in ("", "-smooth")
    )
    return float(100 * (smooth / rough - 1))


_SAWTOOTH = [(section, "sawtooth") for section in ("7.2", "7.3", "7.4")]
_SAWTOOTH += [("7.5", f"sawtooth_{surface}") for surface in (1, 2, 3, 4)]


def largest_unevenness_of_forces(results: Results) -> float:
    """Largest |sawtooth - 1| of the paper's two new elements in sections 7.2 to 7.5."""
    return max(
        abs(results.scalar(f"{section}/{element}", name) - 1)
        for section, name in _SAWTOOTH
        for element in ("pw-T6", "pw-Q8")
    )


def smallest_sawtooth_of_standard(results: Results) -> float:
    """Smallest sawtooth of the two standard elements in sections 7.2 to 7.5."""
    return min(
        results.scalar(f"{section}/{element}", name)
        for section, name in _SAWTOOTH
        for element in ("galerkin-T6", "galerkin-Q8")
    )


def condensation_change(results: Results, section: str) -> float:
    """Largest difference of nodal forces of pw-Q8 and pw-T6, relative to the largest force."""
    a, b = (results.curves(f"{section}/{element}") for element in ("pw-Q8", "pw-T6"))
    differences = [np.abs(a[name] - b[name]).max() for name in ("force_n", "force_t")]
    return float(max(differences) / b["force_n"].max())


def worst_residual(results: Results, section: str) -> float:
    """Largest residual of all contact conditions over all cases of a section."""
    return max(stored.scalars["residual"] for stored in _of_section(results, section))


# 7.5

_MODES = range(1, 7)


def printed_eigenvalue(results: Results, element: str, mode: int) -> float:
    """An eigenvalue of Table 1 as printed."""
    return TABLE_1[element][mode - 1]


def printed_shift(results: Results, element: str, over: str, mode: int) -> float:
    """Relative distance of two printed eigenvalues, in per cent."""
    return 100 * (TABLE_1[element][mode - 1] / TABLE_1[over][mode - 1] - 1)


def largest_printed_shift(results: Results, pairs: Sequence[Sequence[str]]) -> float:
    """Largest size of it over all modes and pairs of columns."""
    return max(
        abs(printed_shift(results, element, over, mode))
        for element, over in pairs
        for mode in _MODES
    )


def printed_shift_size(results: Results, element: str, over: str) -> float:
    """Root mean square of it over the modes."""
    return _rms([printed_shift(results, element, over, mode) for mode in _MODES])


def eigenvalue_shift(results: Results, case: str, over: str, mode: int) -> float:
    """Relative distance of two computed eigenvalues of the column, in per cent."""
    name = f"omega2_{mode}"
    return 100 * (results.scalar(f"7.5/{case}", name) / results.scalar(f"7.5/{over}", name) - 1)


def eigenvalue_shifts(results: Results, cases: str, over: str) -> list[float]:
    """All of them, of the cases whose names match a regular expression."""
    return [
        eigenvalue_shift(results, stored.case, over, mode)
        for stored in _matching(results, "7.5", cases)
        for mode in _MODES
    ]


def largest_eigenvalue_shift(results: Results, cases: str, over: str) -> float:
    """Largest size among them."""
    return max(map(abs, eigenvalue_shifts(results, cases, over)))


def highest_eigenvalue_shift(results: Results, cases: str, over: str) -> float:
    """The highest of them, with its sign."""
    return max(eigenvalue_shifts(results, cases, over))


def mean_eigenvalue_shift(results: Results, case: str, over: str) -> float:
    """Mean over the modes, with its sign."""
    return float(np.mean(eigenvalue_shifts(results, case, over)))


def shift_misfit(results: Results, case: str, over: str, element: str, printed_over: str) -> float:
    """Root mean square over the modes of computed less printed shift, in per cent points."""
    return _rms(
        [
            eigenvalue_shift(results, case, over, mode)
            - printed_shift(results, element, printed_over, mode)
            for mode in _MODES
        ]
    )


def misfit_margin(
    results: Results, cases: str, others: str, over: str, element: str, printed_over: str
) -> float:
    """Smallest misfit among other cases less the largest among the cases, in per cent points."""

    def misfits(names: str) -> list[float]:
        found = _matching(results, "7.5", names)
        return [shift_misfit(results, s.case, over, element, printed_over) for s in found]

    return min(misfits(others)) - max(misfits(cases))


def eigenvalue_over_printed(results: Results, case: str, element: str, mode: int) -> float:
    """Relative distance of a computed eigenvalue from a printed one, in per cent."""
    return 100 * (results.scalar(f"7.5/{case}", f"omega2_{mode}") / TABLE_1[element][mode - 1] - 1)


def largest_eigenvalue_over_printed(results: Results, case: str, element: str) -> float:
    """Largest size of it over the modes."""
    return max(abs(eigenvalue_over_printed(results, case, element, mode)) for mode in _MODES)


def column_height(results: Results, reading: str) -> float:
    """Height in m at which the column's first eigenvalue is CAX8's, printed number for number.

    `reading` is "mixed" (kN with kg) or "SI".
    """
    case = {"mixed": "galerkin-Q8", "SI": "galerkin-Q8-SI"}[reading]
    height = results.curves("7.5/galerkin-Q8")["nodes"][:, 1].max()
    ratio = results.scalar(f"7.5/{case}", "omega2_1") / TABLE_1["CAX8"][0]
    return float(height * np.sqrt(ratio))


def surface_share(results: Results, key: str, surface: int) -> float:
    """Part of the force on surface 4 that a surface carries, in per cent."""
    force = results.scalar(key, f"force_normal_{surface}")
    return 100 * force / results.scalar(key, "force_normal_4")


def column_balance(results: Results) -> float:
    """Largest relative difference of the forces below and on top of the column, all elements."""
    return max(
        abs(sum(surface_share(results, stored.key, surface) for surface in (1, 2, 3)) / 100 - 1)
        for stored in _of_section(results, "7.5")
        if "force_normal_4" in stored.scalars
    )


def column_transfer_defect(results: Results, component: str) -> float:
    """T times the standard triangle's nodal forces against the new one's, on all four surfaces.

    Largest difference in per cent of the surface's mean normal force of a node.
    """
    galerkin, pw = (results.curves(f"7.5/{element}") for element in T6)
    return max(
        100
        * np.abs(galerkin[f"{component}_T_{k}"] - pw[f"{component}_{k}"]).max()
        / pw[f"force_n_{k}"].mean()
        for k in (1, 2, 3, 4)
    )


def axis_force(results: Results, element: str) -> float:
    """Largest normal force of a node on the axis over the mean of its surface's nodes."""
    curves = results.curves(f"7.5/{element}")
    return float(max(curves[f"force_n_{k}"][0] / curves[f"force_n_{k}"].mean() for k in (1, 4)))


def _rms(values: Sequence[float]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


# 7.6


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


def computed_over_exact(results: Results, case: str, mode: int, reference: str) -> float:
    """Relative distance of a computed critical stress from an exact one, in per cent."""
    exact = results.scalar("7.6/exact", f"{reference}_{mode}")
    return 100 * (results.scalar(f"7.6/{case}", f"sigma_cr_{mode}") / exact - 1)


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
        s.case.removeprefix(start) for s in _of_section(results, "7.6") if s.case.startswith(start)
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
        for stored in _of_section(results, "7.6")
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
    for stored in _of_section(results, "7.6"):
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


# The T-identity


def identity_defect(results: Results, quantity: str) -> float:
    """|A_PW - T A_Galerkin| / |A_PW|."""
    return results.scalar(f"T/{quantity}", "difference")


# Known solutions


def largest(results: Results, section: str, cases: str, name: str) -> float:
    """Largest size of a stored number among cases whose names match a regular expression."""
    return max(_sizes(results, section, cases, name))


def smallest(results: Results, section: str, cases: str, name: str) -> float:
    """Smallest size of it."""
    return min(_sizes(results, section, cases, name))


def ratio(results: Results, key: str, other: str, name: str) -> float:
    """A stored number of one case over that of another one."""
    return results.scalar(key, name) / results.scalar(other, name)


def curve_difference(results: Results, key: str, name: str, other: str, other_name: str) -> float:
    """Largest difference of two curves over the same nodes, over the second one's largest size."""
    ours, theirs = results.curves(key)[name], results.curves(other)[other_name]
    return float(np.abs(ours - theirs).max() / np.abs(theirs).max())


def _sizes(results: Results, section: str, cases: str, name: str) -> list[float]:
    return [abs(stored.scalars[name]) for stored in _matching(results, section, cases)]


def _matching(results: Results, section: str, cases: str) -> list[Stored]:
    matching = [s for s in _of_section(results, section) if re.fullmatch(cases, s.case)]
    if not matching:
        raise MissingResult(f"no result of section {section} matches {cases}")
    return matching


# Known solutions with friction


def greco_deviation(results: Results, cases: str, reference: str) -> float:
    """Largest deviation of a displacement of the GRECO plate from known ones, in per cent.

    `cases` is a regular expression; `reference` is "published" or "prototype".
    """
    return max(
        100 * abs(stored.scalars[f"u_{i}"] / greco_known(results, i, reference) - 1)
        for stored in _matching(results, "V6", cases)
        for i in range(1, len(GRECO_PLACES) + 1)
    )


def greco_known(results: Results, place: int, reference: str) -> float:
    """A displacement of the GRECO plate, "published" or of the "prototype", in m."""
    known = {"published": GRECO_PUBLISHED, "prototype": GRECO_PROTOTYPE}[reference]
    return known[place - 1]


def greco_change(results: Results, cases: str, other: str) -> float:
    """Largest deviation of a displacement of the GRECO plate from another case's, in per cent."""
    names = [f"u_{i}" for i in range(1, len(GRECO_PLACES) + 1)]
    return max(
        100 * abs(stored.scalars[name] / results.scalar(f"V6/{other}", name) - 1)
        for stored in _matching(results, "V6", cases)
        for name in names
    )


def zone_end(results: Results, key: str, zone: str) -> float:
    """Where the GRECO plate ceases to be open, or begins to stick: between two nodes, in mm."""
    curves = results.curves(key)
    x, status = curves["x"], curves["status"]
    if zone == "open":
        before = int(np.flatnonzero(status == OPEN).max())
    else:
        before = int(np.flatnonzero(status == STICK).min()) - 1
    return float(1e3 * x[before : before + 2].mean())


def zone_shift(results: Results, key: str, other: str, zone: str) -> float:
    """How far that border moves from one case to another, in mm."""
    return abs(zone_end(results, key, zone) - zone_end(results, other, zone))


def ratio_of(results: Results, key: str, name: str, other: str) -> float:
    """A stored number of a case over another one of the same case."""
    return results.scalar(key, name) / results.scalar(key, other)


def difference_of(results: Results, key: str, name: str, other: str) -> float:
    """A stored number of a case less another one of the same case."""
    return results.scalar(key, name) - results.scalar(key, other)


def relative_difference(results: Results, section: str, cases: str, name: str, other: str) -> float:
    """Largest relative difference of two stored numbers of a case, over matching cases."""
    return max(
        abs(stored.scalars[name] / stored.scalars[other] - 1)
        for stored in _matching(results, section, cases)
    )


def largest_from(results: Results, section: str, cases: str, name: str, value: float) -> float:
    """Largest distance of a stored number from a value, over matching cases."""
    return max(abs(s.scalars[name] - value) for s in _matching(results, section, cases))


def stick_outside(results: Results, cases: str) -> float:
    """Largest distance of the known stick radius from the interval of nodes that holds it."""
    return max(
        max(
            0.0, abs(s.scalars["stick"] - s.scalars["stick_known"]) - s.scalars["stick_between"] / 2
        )
        for s in _matching(results, "V4", cases)
    )


def refinement_order(results: Results, element: str, name: str) -> float:
    """Mean observed order of an error of section V5 from the coarsest to the finest mesh."""
    cases = sorted(
        _matching(results, "V5", rf"{element}-\d+"),
        key=lambda stored: stored.scalars["element_size"],
    )
    size, error = ([cases[i].scalars[what] for i in (0, -1)] for what in ("element_size", name))
    return float(np.log(error[1] / error[0]) / np.log(size[1] / size[0]))


# Vibration with known answers


def mode_errors(results: Results, key: str) -> np.ndarray:
    """Relative errors of the values on the finest mesh, with their signs."""
    errors: np.ndarray = results.curves(key)["errors"][-1]
    return errors


def highest_mode_error(results: Results, key: str) -> float:
    """The largest of them: negative if all values lie below the exact ones."""
    return float(mode_errors(results, key).max())


def largest_mode_error_ratio(results: Results, key: str, other: str) -> float:
    """Largest ratio of a mode's errors of two cases on their finest meshes."""
    return float(np.abs(mode_errors(results, key) / mode_errors(results, other)).max())


def finest_imaginary(results: Results, key: str) -> float:
    """Largest |Im| over |Re| of the eigenvalues on the finest mesh."""
    return float(results.curves(key)["imaginaries"][-1])


# Orders of convergence


def largest_error_ratio(results: Results, settings: str, name: str) -> float:
    """Largest error of the new T6 or T10 over the standard one's on the finest meshes.

    `settings` is a regular expression for what follows the element in a case's name.
    """
    return max(
        ours.scalars[name] / standard.scalars[name]
        for ours, standard in _convergence_pairs(results, settings)
    )


def largest_ratio_on_meshes(results: Results, settings: str, name: str) -> float:
    """The same on any of the meshes."""
    return max(
        float((ours.curves[name] / standard.curves[name]).max())
        for ours, standard in _convergence_pairs(results, settings)
    )


def ratio_at_poissons_ratio(results: Results, settings: str, name: str, nu: float) -> float:
    """Largest ratio of both errors at a Poisson's ratio among the scans over it."""
    ratios = []
    for ours, standard in _convergence_pairs(results, f"nu-({settings})"):
        (place,) = np.flatnonzero(ours.curves["nu"] == nu)
        ratios.append(float(ours.curves[name][place] / standard.curves[name][place]))
    return max(ratios)


def _convergence_pairs(results: Results, settings: str) -> list[tuple[Stored, Stored]]:
    """Results of the new T6 or T10, and of the standard one in the same setting."""
    return [
        (ours, results[ours.key.replace("C/pw-", "C/galerkin-")])
        for ours in _matching(results, "C", f"pw-T(6|10)-({settings})")
    ]


# The independent code

CONTACT_PEERS = (
    "block-even",
    "block-part",
    "block-lifting",
    "block-friction-0.15",
    "block-friction-0.30",
)


def peer_worst(
    results: Results, name: str, component: str, cases: Sequence[str] = CONTACT_PEERS
) -> float:
    """Largest of one kind of difference from CalculiX, per cent of the mean nodal force."""
    return 100 * max(
        value
        for case in cases
        for scalar, value in results[f"P/{case}"].scalars.items()
        if scalar == f"{name}_{component}"
    )


def peer_critical_stress(results: Results, element: str) -> float:
    """Largest relative difference of a critical stress from CalculiX's."""
    beams = [s for s in _of_section(results, "P") if f"difference_{element}" in s.scalars]
    return max(s.scalars[f"difference_{element}"] for s in beams)
