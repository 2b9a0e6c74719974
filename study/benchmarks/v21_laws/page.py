"""Verification of interface laws, of heat across a joint, and of nodes in two pairs."""

from study.benchmarks.v21_laws.joints import groove, joint, tie, uniform
from study.judge.checks import check
from study.judge.measures.general import largest, scalar
from study.run.cases import Case

SECTION = "V21"
TITLE = "Laws at the interface"
FACTS = {
    "geometry": "bars on a floor, two blocks with a joint, a block in a right-angled groove",
    "mesh": "T6 and T10, 3 to 16 elements along an interface",
    "material": "linear elastic, E = 1000, ν = 0 or 0.3",
    "supports": "one end held, or symmetric; matching nodes, and a mesh that does not match",
    "load": "uniform or linear pressure; a hot floor, or a temperature difference",
    "reference": "uniform and linear stress; a cosine series of the heat flux; statics",
    "uncertainty": "none; the series has 400 terms",
}

CASES = [
    *(
        Case("V21", f"uniform-{element}", uniform, {"element": element})
        for element in ("pw-T6", "galerkin-T6", "pw-T10", "galerkin-T10")
    ),
    *(
        Case("V21", f"joint-{element}-{n}", joint, {"element": element, "elements": n})
        for element in ("pw-T6", "galerkin-T6")
        for n in (4, 8, 16)
    ),
    *(Case("V21", f"tie-pw-T6-{n}", tie, {"element": "pw-T6", "elements": n}) for n in (4, 8)),
    *(
        Case("V21", f"groove-{element}", groove, {"element": element})
        for element in ("pw-T10", "galerkin-T10")
    ),
]

CHECKS = [
    check(
        "V21-uniform",
        "Bars under wear, heat, an elastic layer, cohesion and friction, new elements: largest error "
        "of a nodal traction or flux over tributary areas.",
        lambda results: largest(results, "V21", "uniform-pw-.*", "largest_tributary"),
        "<",
        1e-7,
        tolerance_why="round-off and the iteration's tolerance",
        tolerance_set="before",
        why="Weights are tributary areas, and uniform tractions satisfy each law.",
    ),
    check(
        "V21-worn-depth",
        "Bar of new tetrahedra, worn between two held ends: largest relative error of a worn depth.",
        lambda results: scalar(results, "V21/uniform-pw-T10", "worn_depth_error"),
        "<",
        1e-7,
        tolerance_why="round-off and the iteration's tolerance",
        tolerance_set="before",
        why="All nodes have a weight, and hence a pressure that wears them.",
    ),
    check(
        "V21-joint",
        "Heat across a joint under a linear pressure, 16 elements, both elements: largest error of "
        "the total flow.",
        lambda results: largest(results, "V21", "joint-.*-16", "total_error"),
        "<",
        0.002,
        tolerance_why="none: a bound",
        tolerance_set="before",
        why="The flux is smooth, and pressures are exact but for the two ends.",
    ),
    check(
        "V21-tie",
        "Tied blocks in bending, 8 elements on 12: error of the largest displacement.",
        lambda results: scalar(results, "V21/tie-pw-T6-8", "displacement_error"),
        "<",
        0.01,
        tolerance_why="none: a bound",
        tolerance_set="before",
        why="Displacements are quadratic, and the tie's weights linear.",
    ),
    check(
        "V21-groove",
        "Block dragged along a groove, both elements: difference of the drag from the exact one.",
        lambda results: max(
            abs(scalar(results, f"V21/groove-{e}-T10", "drag_over_exact") - 1)
            for e in ("pw", "galerkin")
        ),
        "<",
        1e-3,
        tolerance_why="friction is not quite axial, since the block deforms",
        tolerance_set="before",
        why="Friction over sin 45° is the drag coefficient of a right-angled groove.",
    ),
]

DETAILS = r"""
Draft: tables, figures and findings are still to be written.
"""
