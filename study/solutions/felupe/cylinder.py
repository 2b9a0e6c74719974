"""Neo-Hookean block ironed by a rough rigid cylinder, computed with felupe, as in section V16.

felupe and its recommended solver pypardiso are no dependencies of the project. This module needs
both, but not DOLFINx; see `find_missing_packages`. The mesh, the strain energy and the motion of
the cylinder are those of the library's problem. Contact is felupe's own: the nodes of the surface
against a rigid cylinder, with a penalty for the normal direction and elastic slip of sticking
nodes.
"""

import time
import warnings
from dataclasses import dataclass
from importlib.metadata import version
from importlib.util import find_spec

import numpy as np

from study.solutions.calculix.cylinder import HALF_WIDTH, HEIGHT, CylinderOnRubberBlock
from study.solutions.calculix.output import Array

PACKAGES = ("felupe", "pypardiso")
"""Packages that `solve_with_felupe` imports."""
FRICTION, TOOL_DEPTH, TOOL_TRAVEL = 0.3, 0.5, 0.6
"""Coulomb's coefficient; motion of the cylinder downwards, then sideways, in its radii."""
CONTACT_ZONE_FRACTION = 0.9
"""Fraction of the block's half width within which nodes may come into contact."""
LAME_OVER_SHEAR_MODULUS = 1.5
"""Lamé's first constant divided by the shear modulus, for Poisson's ratio 0.3."""
PENALTY, ELASTIC_SLIP = 200.0, 0.01
"""Pressure over penetration (in shear moduli / radius), and slip (in radii) at which sticking ends.

`PENALTY` times the length of an element is felupe's multiplier. Of 80, 200, 500 and 800, 200 takes
the least time among those with which forces change by at most one per cent if the penalty is ten
times larger and the slip ten times smaller."""


@dataclass(frozen=True)
class FelupeResult:
    """Result of felupe after the last increment.

    Attributes:
        unknowns: Number of displacements of the block, including prescribed ones.
        iterations: Number of Newton iterations, each with one factorisation.
        seconds: CPU seconds of the solution, without imports and meshing.
        normal_force: Force of the cylinder on the block, downwards.
        tangential_force: Force of the cylinder on the block in the direction of its motion.
        position: Undeformed coordinates (m,) of the nodes in contact along the surface, sorted.
        nodal_normal_force: Nodal forces (m,) along the cylinder's normals.
        is_corner: Mask (m,) of the nodes in contact that are corners of elements.
    """

    unknowns: int
    iterations: int
    seconds: float
    normal_force: float
    tangential_force: float
    position: Array
    nodal_normal_force: Array
    is_corner: np.ndarray


def find_missing_packages() -> list[str]:
    """Return the names of the required packages that cannot be imported."""
    return [name for name in PACKAGES if find_spec(name) is None]


def list_versions() -> dict[str, str]:
    """Return the versions of felupe and of the packages with which it computes."""
    return {name: version(name) for name in (*PACKAGES, "numpy", "scipy")}


def list_cylinder_translations(n_pressing: int, n_ironing: int) -> list[tuple[float, float]]:
    """Return the translations (x, y) of the cylinder at the ends of the increments.

    Args:
        n_pressing: Number of increments in which the cylinder moves down.
        n_ironing: Number of increments in which it moves sideways afterwards.
    """
    down = [(0.0, -TOOL_DEPTH * k / n_pressing) for k in range(1, n_pressing + 1)]
    return down + [(TOOL_TRAVEL * k / n_ironing, -TOOL_DEPTH) for k in range(1, n_ironing + 1)]


def solve_with_felupe(
    elements_along_tool_radius: int,
    translations: list[tuple[float, float]],
    penalty: float = PENALTY,
    elastic_slip: float = ELASTIC_SLIP,
) -> FelupeResult:
    """Press and iron the block with felupe, with one increment per translation.

    The tangent is the consistent one (curvature "trial"); other settings are felupe's defaults.

    Args:
        elements_along_tool_radius: Number of elements along the cylinder's radius.
        translations: Translations (x, y) of the cylinder at the ends of the increments.
        penalty: Pressure over penetration, in shear moduli / radius.
        elastic_slip: Slip, in radii, at which a sticking node begins to slip.

    Raises:
        felupe.NewtonConvergenceError: If an increment does not converge.
    """
    import felupe
    import pypardiso

    problem = CylinderOnRubberBlock(elements_along_tool_radius, FRICTION)
    cells = np.array(problem.grid.elements) - 1
    mesh = felupe.Mesh(np.array(problem.nodes), cells, "triangle6")
    unknowns = mesh.points.size
    mesh.add_points([[0.0, 1.0]])  # centre of the cylinder
    start = time.process_time()
    displacement = felupe.FieldPlaneStrain(felupe.RegionQuadraticTriangle(mesh), dim=2)
    field = felupe.FieldContainer([displacement])
    material = felupe.NeoHookeCompressible(mu=1.0, lmbda=LAME_OVER_SHEAR_MODULUS)
    body = felupe.SolidBody(material, field)
    x, y = mesh.points.T
    may_touch = np.flatnonzero(np.isclose(y, 0) & (np.abs(x) < CONTACT_ZONE_FRACTION * HALF_WIDTH))
    contact = felupe.ContactRigidCylinder(
        field,
        may_touch,
        centerpoint=-1,
        radius=1.0,
        friction=FRICTION,
        multiplier=penalty / elements_along_tool_radius,
        elastic_slip=elastic_slip,
        curvature="trial",
    )
    boundaries = {
        "base": felupe.Boundary(displacement, fy=-HEIGHT),
        "aside": felupe.Boundary(displacement, fy=1.0, skip=(0, 1)),
        "down": felupe.Boundary(displacement, fy=1.0, skip=(1, 0)),
    }
    aside, down = np.array(translations).T
    step = felupe.Step(
        [body, contact],
        ramp={boundaries["aside"]: aside, boundaries["down"]: down},
        boundaries=boundaries,
    )

    class IterationCounter(felupe.Plugin):
        iterations = 0

        def after_iteration(self, *_: object) -> None:
            self.iterations += 1

    counter = IterationCounter()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        felupe.Job([step], plugins=[counter]).evaluate(verbose=0, solver=pypardiso.spsolve)
    seconds = time.process_time() - start
    force_of_body = contact.results.force.toarray().reshape(-1, 2)
    touching = may_touch[contact.results.active]
    touching = touching[np.argsort(x[touching])]
    arm = mesh.points[touching] + displacement.values[touching]
    arm -= mesh.points[-1] + displacement.values[-1]
    normal = arm / np.linalg.norm(arm, axis=1)[:, None]
    return FelupeResult(
        unknowns,
        counter.iterations,
        seconds,
        -float(force_of_body[-1, 1]),
        float(force_of_body[-1, 0]),
        x[touching],
        -np.sum(force_of_body[touching] * normal, axis=1),
        np.isin(touching, cells[:, :3]),
    )
