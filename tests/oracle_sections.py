"""The problem of each section, stated again for the oracle, beside what the study computes.

A section's function runs a case of the study on an element and gives a `Problem`: numbers of the
result by name, and a function that finds them anew with the oracle. Only the mesh is taken from
the result; loads, supports, materials and surfaces are written down again.

The integrals of triangles that touch the axis with one vertex, where 1/r is no smooth factor, and
of curved ones depend on the rule, and the study's of degree 8 leaves more than 1e-8. There both
sides get rules of their own that have converged (`RULES`); `tests/test_oracle.py` has what degree 8
leaves.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from unittest.mock import patch

import numpy as np
from scipy.sparse.linalg import splu

from pw_elements.contact import FlatPunch, Parabola
from pw_elements.elasticity import StressState, body
from study.paper import (
    s7_1_two_triangles,
    s7_2_block,
    s7_3_parabolic_punch,
    s7_4_rigid_plate,
    s7_5_column,
    s7_5_profiles,
    s7_6_buckling,
)
from study.verification import (
    indentation,
    v1_contact_patch,
    v2_hertz,
    v3_flat_punch,
    v4_spence,
    v5_cattaneo,
    v6_greco,
    v7_wedge,
    v8_vibration,
)
from tests.oracle.assembly import Body
from tests.oracle.contact import Pair, solve
from tests.oracle.eigen import smallest

# Degree of the library's rule, points a direction of the oracle's. On quadrilaterals the study's
# own degree 8 is Gauss's 5 points in both; triangles have rules over whole cells with quadratic
# weights, over each sub-cell with piecewise-linear ones
RULES = {"quadrilaterals": (8, 5), "triangles": (50, 24), "sub-triangles": (30, 16)}
NORMAL_UP, NORMAL_DOWN = (0.0, 1.0), (0.0, -1.0)
Numbers = dict[str, np.ndarray]


@dataclass(frozen=True)
class Problem:
    """Numbers of the study, and the same by the oracle.

    Args:
        theirs: by name.
        ours: the same, from whether weights are piecewise linear.
        scales: what differences of a name are relative to, if not its largest number.
    """

    theirs: Numbers
    ours: Callable[[bool], Numbers]
    scales: dict[str, float] = field(default_factory=dict)

    def differences(self, linear_weights: bool) -> dict[str, float]:
        ours, found = self.ours(linear_weights), {}
        for name, theirs in self.theirs.items():
            scale = self.scales.get(name, np.abs(theirs).max())
            assert 0 < scale < np.inf, name
            found[name] = float(np.abs(theirs - ours[name]).max() / scale)
        return found


def on(axis, value):
    return lambda x: np.isclose(x[:, axis], value)


def within(limit):
    return lambda x: np.abs(x[:, 0]) < limit + 1e-9


def both(*conditions):
    return lambda x: np.all([condition(x) for condition in conditions], axis=0)


def either(*conditions):
    return lambda x: np.any([condition(x) for condition in conditions], axis=0)


def sorted_nodes(curves, where):
    """Numbers of the nodes that a condition holds on, by x and then y."""
    x = curves["nodes"]
    nodes = np.flatnonzero(where(x))
    return nodes[np.lexsort((x[nodes, 1], x[nodes, 0].round(9)))]


def oracle_body(result, element, linear, state, E, nu, **more):
    """The oracle's body on the mesh of a result; pw-Q8 are triangles, its inner nodes kept."""
    kind = element.removeprefix("pw-").removeprefix("pwsym-").removeprefix("galerkin-")
    kind = "T6" if element == "pw-Q8" else kind
    curves = result.curves
    return Body(curves["nodes"], curves["cells"], kind, linear, state, E, nu, **more)


def plane(normal, level=0.0):
    """Gap and normal of a horizontal plane, for a `Pair`."""
    return (
        lambda x: (x[:, 1] - level) * normal[1],
        lambda x: np.tile(normal, (len(x), 1)),
    )


def parabola(apex, radius):
    """A punch that presses downwards."""
    return (lambda x: x[:, 0] ** 2 / (2 * radius) - (x[:, 1] - apex)), plane(NORMAL_DOWN)[1]


def converged(element):
    """The library's rule for integrands that are no polynomials, of a higher degree."""
    return patch.object(body, "_RATIONAL_DEGREE", rule(element)[0])


def points(element):
    """What the oracle's Gauss rule has in each direction instead."""
    return rule(element)[1]


def rule(element):
    if element in ("galerkin-Q8", "pw-Q9"):
        return RULES["quadrilaterals"]
    return RULES["sub-triangles" if element.startswith("pw") else "triangles"]


def nothing_held(body):
    return np.zeros(body.nodes.shape, dtype=bool)


def contact_problem(result, solved, normal, tangent=(-1.0, 0.0), displacement=True, **further):
    """Forces along one contact line and their sums; displacements and more, where stored.

    Args:
        result: of the study.
        solved: gives the oracle's last state, from whether weights are piecewise linear.
        normal: forces of the surface on the body count along it, and along
        tangent: mostly against x, for the study stores those of the body on the surface.
        displacement: whether displacements are stored.
        further: by name, a number of the result, and how to get it from the state.
    """
    names = ["force_n", "force_t"] + ["displacement"] * displacement
    theirs = {name: result.curves[name] for name in names}
    theirs |= {name: result.scalars[name] for name in ("force_normal", "force_tangential")}
    theirs |= {name: number for name, (number, _) in further.items()}

    def ours(linear):
        state = solved(linear)
        force_n, force_t = state.forces[0] @ normal, state.forces[0] @ tangent
        found = {"force_n": force_n, "force_t": force_t, "displacement": state.displacement}
        found |= {"force_normal": force_n.sum(), "force_tangential": force_t.sum()}
        return found | {name: of(state) for name, (_, of) in further.items()}

    scales = {"force_t": theirs["force_n"].max(), "force_tangential": theirs["force_normal"]}
    return Problem(theirs, ours, scales)


def two_triangles(element):
    result = s7_1_two_triangles.structure(element, squares=2)

    def ours(linear):
        body = oracle_body(result, element, linear, "plane stress", 1.0, 0.3)
        lower = sorted_nodes(result.curves, on(1, 0.0))
        held = body.at_nodes(on(1, 0.0), (1,))
        held |= body.at_nodes(both(on(0, 0.0), on(1, 0.0)), (0,))
        f = body.traction(on(1, 1.0), (0.0, -1.0))
        K = body.stiffness()
        residual = (K @ displacement(K, f, held) - f).reshape(-1, 2)
        return {"reaction": residual[lower, 1], "sum": residual[lower, 1].sum()}

    theirs = {"reaction": result.curves["reaction"], "sum": result.scalars["sum"]}
    return Problem(theirs, ours)


def displacement(K, f, held):
    """Displacements (n dim,) under a load."""
    kept = np.flatnonzero(~held.ravel())
    u = np.zeros(len(f))
    u[kept] = splu(K[kept][:, kept].tocsc()).solve(f[kept])
    return u


def block(element, divisions=(20, 10)):
    result = s7_2_block.block(element, divisions=divisions)

    def solved(linear):
        body = oracle_body(result, element, linear, "plane stress", 1000.0, 0.3)
        pressure = body.traction(on(1, 2.0), (0.0, -200.0))
        pull = body.traction(on(0, 4.0), (60.0, 0.0))
        lower = sorted_nodes(result.curves, on(1, 0.0))
        x = body.nodes[lower, 0]
        rough = np.where((x > 0.2 - 1e-9) & (x < 3.8 + 1e-9), 0.3, 0.0)
        loads = [pressure + k / 10 * pull for k in range(11)]
        pair = Pair(lower, *plane(NORMAL_UP), rough)
        return solve(body.stiffness(), loads, nothing_held(body), [pair], body.nodes)[-1]

    return contact_problem(result, solved, NORMAL_UP)


def parabolic_punch(element):
    result = s7_3_parabolic_punch.punch(element)

    def solved(linear):
        body = oracle_body(result, element, linear, "plane stress", 1000.0, 0.25)
        K, held = body.stiffness(), body.at_nodes(on(1, 0.0), (0, 1))
        top = sorted_nodes(result.curves, on(1, 4.0))
        steps = np.arange(1, 21) / 20
        down = [((0.0, -0.25 * s), (0.0, 0.0)) for s in steps]

        def pressed(motions):
            pair = Pair(top, *parabola(4.0, 8.0), 0.6, motions)
            return solve(K, [np.zeros(body.nodes.size)] * len(motions), held, [pair], body.nodes)

        force = -pressed(down)[-1].forces[0][:, 1].sum()
        aside = [((None, -0.25), (0.1 * force * s, 0.0)) for s in steps]
        return pressed(down + aside)[-1]

    translation = (result.scalars["translation"], lambda state: state.translations[0, 0])
    return contact_problem(result, solved, NORMAL_DOWN, translation=translation)


def rigid_plate(element):
    result = s7_4_rigid_plate.plate(element)

    def solved(linear):
        body = oracle_body(result, element, linear, "plane stress", 1.2e8, 0.25)
        outside = either(on(0, -20.0), on(0, 20.0), on(1, -10.0))
        below = sorted_nodes(result.curves, both(on(1, 0.0), within(1.0)))
        motions = [((0.0, None), (0.0, -40.0 * k / 5)) for k in range(1, 6)]
        pair = Pair(below, *plane(NORMAL_DOWN), np.tan(np.pi / 9), motions)
        loads, held = [np.zeros(body.nodes.size)] * 5, body.at_nodes(outside, (0, 1))
        return solve(body.stiffness(), loads, held, [pair], body.nodes)[-1]

    translation = (result.scalars["translation"], lambda state: -state.translations[0, 1])
    return contact_problem(result, solved, NORMAL_DOWN, translation=translation)


# The first of the study's columns, its radii and heights from the base, in a coarser mesh
RADII, HEIGHTS = (0.04787, 0.11121, 0.14669, 0.04126), (0.23155, 0.14025, 0.18777, 0.03384)
COARSE = s7_5_profiles.Profile(RADII, HEIGHTS, (2, 1, 2, 1), (6, 4, 5, 2))


def stepped_column(element):
    with patch.dict(s7_5_column.PROFILES, coarse=COARSE), converged(element):
        result = s7_5_column.stepped_column(element, section="coarse")
    level = np.concatenate([[0.0], np.cumsum(HEIGHTS)])
    faces = [
        (0.0, RADII[0], level[0], NORMAL_UP, 0.0),
        (RADII[0], RADII[1], level[1], NORMAL_UP, 1e-4),
        (RADII[1], RADII[2], level[2], NORMAL_UP, 2e-4),
        (0.0, RADII[3], level[4], NORMAL_DOWN, 0.0),
    ]
    count = points(element)

    def ours(linear):
        body = oracle_body(
            result, element, linear, "axisymmetric", 2.1e8, 0.3, rho=7856.0, count=count
        )
        K, on_axis = body.stiffness(), body.at_nodes(on(0, 0.0), (0,))
        descent = [((0.0, -1e-4 * k), (0.0, 0.0)) for k in range(1, 11)]
        pairs = []
        for inner, outer, z, normal, gap in faces:
            between = both(
                on(1, z), lambda x, a=inner, b=outer: (x[:, 0] > a - 1e-9) & (x[:, 0] < b + 1e-9)
            )
            motions = descent if normal is NORMAL_DOWN else ()
            nodes = sorted_nodes(result.curves, between)
            pairs.append(Pair(nodes, *plane(normal, z - gap), 0.3, motions))
        loads = [np.zeros(body.nodes.size)] * 10
        state = solve(K, loads, on_axis, pairs, body.nodes)[-1]
        found = {"displacement": state.displacement}
        for k, (face, force) in enumerate(zip(faces, state.forces, strict=True), 1):
            found[f"force_n_{k}"], found[f"force_t_{k}"] = force @ face[3], -force[:, 0]
            found[f"force_normal_{k}"] = found[f"force_n_{k}"].sum()
        standing = on_axis | body.at_nodes(on(1, 0.0), (1,))
        found["omega2"] = smallest(K, body.mass(), standing, 6).real
        return found

    scalars, curves = result.scalars, result.curves
    theirs = {"omega2": np.array([scalars[f"omega2_{i}"] for i in range(1, 7)])}
    theirs["displacement"] = curves["displacement"]
    for k in range(1, 5):
        theirs |= {f"force_{c}_{k}": curves[f"force_{c}_{k}"] for c in "nt"}
        theirs[f"force_normal_{k}"] = scalars[f"force_normal_{k}"]
    if element in ("pw-Q8", "pw-Q9"):  # their inner nodes are condensed, which changes M
        del theirs["omega2"]
    scales = {f"force_t_{k}": theirs[f"force_n_{k}"].max() for k in range(1, 5)}
    return Problem(theirs, ours, scales)


def beam(element, load="point"):
    uniform = load == "uniform"
    mesh = ((8, 2), "right", "face", "face") if uniform else ((5, 2), "crossed", "centre", "centre")
    result = s7_6_buckling.beam(element, "G", load, *mesh)

    def ours(linear):
        body = oracle_body(result, element, linear, "plane stress", 2.07e11, 0.0, thickness=0.1)
        end, middle = on(0, 0.0), on(0, 4.0)
        A, centre = both(end, on(1, 0.0)), both(middle, on(1, 0.0))
        symmetrised = element.startswith("pwsym")
        K = symmetric_part(body.stiffness()) if symmetrised else body.stiffness()
        found = {}
        for mode in (1, 2):
            held = body.at_nodes(end if uniform else A, (1,))
            if mode == 1:
                held |= body.at_nodes(middle, (0,))
            else:
                held |= body.at_nodes(centre, (0,))
                held |= body.at_nodes(middle if uniform else centre, (1,))
            if uniform:
                f = body.traction(end, (1.0, 0.0))
                f += body.traction(middle, (-1.0, 0.0)) * (mode == 2)
            else:
                f = 0.1 * body.at_nodes(A, (0,)).ravel()
            K_sigma = body.geometric_stiffness(displacement(K, f, held))
            K_sigma = symmetric_part(K_sigma) if symmetrised else K_sigma
            factors = smallest(K, -K_sigma, held, 4).real
            found[f"sigma_cr_{mode}"] = factors[factors > 0].min()
        return found

    return Problem({name: result.scalars[name] for name in ("sigma_cr_1", "sigma_cr_2")}, ours)


def symmetric_part(A):
    return (A + A.T) / 2


def patch_test(element, mesh="distorted", state="plane strain"):
    with converged(element):
        result = v1_contact_patch.patch(element, mesh, state)

    def solved(linear):
        count = 3 if (mesh, state) == ("distorted", "plane strain") else points(element)
        body = oracle_body(result, element, linear, state, 1000.0, 0.3, count=count)
        pair = Pair(sorted_nodes(result.curves, on(1, 0.0)), *plane(NORMAL_UP))
        load, held = body.traction(on(1, 1.0), (0.0, -3.0)), body.at_nodes(on(0, 0.0), (0,))
        return solve(body.stiffness(), [load], held, [pair], body.nodes)[-1]

    return contact_problem(result, solved, NORMAL_UP, displacement=False)


def indented(element, state, E, force, surface, oracle_surface, lines, known, mu=0.0):
    """V2 and V3: half of a body under an indenter, its outer sides held."""
    indenter = indentation.Indenter(known, surface, StressState(state))
    with converged(element):
        result = indentation.series(element, indenter, {4: [lines]}, far_field=False)

    def solved(linear):
        count = points(element) if state == "axisymmetric" else 3
        body = oracle_body(result, element, linear, state, E, 0.3, count=count)
        (right, _), (_, bottom) = body.nodes.max(axis=0), body.nodes.min(axis=0)
        held = body.at_nodes(either(on(0, right), on(1, bottom)), (0, 1))
        held |= body.at_nodes(on(0, 0.0), (0,))
        top = sorted_nodes(result.curves, both(on(1, 0.0), within(lines[-1])))
        pair = Pair(top, *oracle_surface, mu, [((0.0, None), (0.0, -force))])
        return solve(body.stiffness(), [np.zeros(body.nodes.size)], held, [pair], body.nodes)[-1]

    gap = {"gap": (result.curves["gap"], lambda state: state.gaps[0])}
    if isinstance(surface, FlatPunch):  # all gaps are closed
        gap = {}
    return contact_problem(result, solved, NORMAL_DOWN, displacement=False, **gap)


def hertz_line(element):
    E, lines = 52.5e3, 1.6 * np.arange(7)
    body = v2_hertz.Elastic(E, 0.3)
    known = v2_hertz.HertzLine(body, 50.0, 35e3)
    surface, ours = Parabola((0.0, 0.0), 50.0), parabola(0.0, 50.0)
    return indented(element, "plane strain", E, 17.5e3, surface, ours, lines, known)


def hertz_sphere(element):
    E, lines = 70e3, 0.7 * np.arange(7)
    known = v2_hertz.HertzSphere(v2_hertz.Elastic(E, 0.3), 50.0, 35e3)
    surface, ours = Parabola((0.0, 0.0), 50.0), parabola(0.0, 50.0)
    return indented(element, "axisymmetric", E, 35e3, surface, ours, lines, known)


def punch(element, kind="smooth"):
    known, state = v3_flat_punch.KINDS[kind]
    surface, ours = FlatPunch((0.0, 0.0), NORMAL_DOWN, 1.0), plane(NORMAL_DOWN)
    force, mu = (3.0 if kind == "round" else 1.5), (1e3 if kind == "bonded" else 0.0)
    lines = np.linspace(0.0, 1.0, 5)
    return indented(element, state.value, 1000.0, force, surface, ours, lines, known, mu)


def spence_punch(element):
    mu = np.tan(np.pi / 9)
    result = v4_spence.stick_radius(element, 0.25, mu, 16, far_field=False)

    def solved(linear):
        body = oracle_body(result, element, linear, "plane strain", 1.0, 0.25)
        held = body.at_nodes(either(on(0, 5.0), on(1, -5.0)), (0, 1))
        held |= body.at_nodes(on(0, 0.0), (0,))
        below = sorted_nodes(result.curves, both(on(1, 0.0), within(1.0)))
        motions = [((0.0, None), (0.0, -5e-4 * share)) for share in (0.5, 1.0)]
        pair = Pair(below, *plane(NORMAL_DOWN), mu, motions)
        loads = [np.zeros(body.nodes.size)] * 2
        return solve(body.stiffness(), loads, held, [pair], body.nodes)[-1]

    return contact_problem(result, solved, NORMAL_DOWN)


def partial_slip(element):
    """Two bodies, node on node; the study has one unknown for both nodes of a pair."""
    result = v5_cattaneo.partial_slip(element, 10, far_field=False)
    force = np.pi / (2 * (1 - 0.3**2)) / 4e4

    def solved(linear):
        body = oracle_body(result, element, linear, "plane strain", 1.0, 0.3)
        outside = either(on(1, -5.0), on(1, 6.0), on(0, -5.0), on(0, 5.0))
        lower, upper = (
            sorted_nodes(result.curves, both(on(1, y), within(1.25))) for y in (0.0, 1.0)
        )
        motions = [((0.0, None), (0.0, -force))]
        motions += [((None, None), (s * 0.4 * force, -force)) for s in (0.25, 0.5)]
        pair = Pair(lower, *parabola(0.0, 1e4), 0.4, motions, opposite=upper)
        loads, held = [np.zeros(body.nodes.size)] * 3, body.at_nodes(outside, (0, 1))
        return solve(body.stiffness(), loads, held, [pair], body.nodes)[-1]

    return contact_problem(result, solved, NORMAL_DOWN, (1.0, 0.0), displacement=False)


def greco_plate(element):
    result = v6_greco.plate(element, 16)

    def solved(linear):
        body = oracle_body(result, element, linear, "plane strain", 1.3e11, 0.2)
        load = body.traction(on(1, 0.04), (0.0, -5e7)) + body.traction(on(0, 0.0), (15e7, 0.0))
        pair = Pair(sorted_nodes(result.curves, on(1, 0.0)), *plane(NORMAL_UP), 1.0)
        held = body.at_nodes(on(0, 0.04), (0,))
        return solve(body.stiffness(), [load], held, [pair], body.nodes)[-1]

    return contact_problem(result, solved, NORMAL_UP)


def sliding_wedge(element):
    result = v7_wedge.sliding(element, 0.2, (8, 2))
    normal, downhill = (np.array(v) / np.hypot(0.1, 1.0) for v in ((-0.1, 1.0), (-1.0, -0.1)))

    def solved(linear):
        body, left = oracle_body(result, element, linear, "plane strain", 1e7, 0.3), on(0, 0.0)
        base = sorted_nodes(result.curves, lambda x: np.isclose(x[:, 1], 0.1 * x[:, 0]))
        K = body.stiffness() + body.springs(left, 0, 563.9 / 1.2)
        weight = body.body_load((0.0, -3058.0 / (4.0 * 1.0)))
        push = body.traction(left, (1500.0 / 1.2, 0.0))
        loads = [weight + k / 5 * push for k in range(6)]
        pair = Pair(base, lambda x: x @ normal, lambda x: np.tile(normal, (len(x), 1)), 0.2)
        return solve(K, loads, nothing_held(body), [pair], body.nodes)[-1]

    def mean_displacement(state):
        """Of the left side, whatever the weights: by the integrals of the trial functions."""
        body = oracle_body(result, element, False, "plane strain", 1e7, 0.3)
        return body.traction(on(0, 0.0), (1.0 / 1.2, 0.0)) @ state.displacement.ravel()

    sliding = (result.scalars["sliding"], mean_displacement)
    return contact_problem(result, solved, normal, downhill, displacement=False, sliding=sliding)


def vibrating(element, case="square"):
    run = {"rod": v8_vibration.rod, "square": v8_vibration.square, "strip": v8_vibration.strip}[
        case
    ]
    squares = (1, 2) if case == "strip" else (2, 4)
    with converged(element):
        result = run(element, "all nodes", squares)

    def ours(linear):
        state, count = ("axisymmetric", points(element)) if case == "rod" else ("plane stress", 3)
        body = oracle_body(result, element, linear, state, 1.0, 0.3, count=count)
        K, M = body.stiffness(), body.mass()
        if element.startswith("pwsym"):
            K, M = symmetric_part(K), symmetric_part(M)
        if case == "strip":
            held = body.at_nodes(either(on(0, 0.0), on(0, 8.0)), (1,))
            wave = np.arange(1, 4) * np.pi / 8
            # nothing but stiffness keeps it from moving along: the first eigenvalue is zero
            found = smallest(K, M, held, 4, shift=-1e-3).real[1:] / wave**2
            u = body.nodes * (-1.0, 0.3)  # uniaxial stress -1
            held |= body.at_nodes(both(on(0, 0.0), on(1, 0.0)), (0,))
            K_sigma = body.geometric_stiffness(u.ravel())
            K_sigma = symmetric_part(K_sigma) if element.startswith("pwsym") else K_sigma
            critical = np.sort(smallest(K, -K_sigma, held, 6).real)
            return {"vibration": found, "buckling": critical[critical > 0][:3]}
        held = body.at_nodes(on(0, 0.0), (0,)) | body.at_nodes(on(1, 0.0), (1,))
        held |= body.at_nodes(on(1, 1.0), (1,))
        if case == "square":
            held |= body.at_nodes(on(0, 1.0), (0,))
        return {"omega2": smallest(K, M, held, 6).real}

    names = {"omega2": 6} if case != "strip" else {"vibration": 3, "buckling": 3}
    theirs = {
        name: np.array([result.scalars[f"{name}_{i}"] for i in range(1, n + 1)])
        for name, n in names.items()
    }
    return Problem(theirs, ours)
