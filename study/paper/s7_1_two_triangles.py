"""7.1 Simple structure with two elements: the reactions under a uniform load (Figs 4 and 5)."""

from mpi4py import MPI

import numpy as np
from dolfinx.mesh import Mesh

from pw_elements import Material, forces_along, prescribe, reactions, solve
from pw_elements.elasticity import StressState
from pw_elements.meshes import DiagonalPattern, quadrilaterals, triangles
from study.model.discretisation import discretise, mesh_curves
from study.model.units import UNSTATED
from study.run.cases import Case
from study.run.store import Result

SECTION = "7.1"
TITLE = "Simple structure with two elements"

# Printed: unit square, unit thickness, unit load. Not printed: E and nu, on which the reactions
# do not depend; MATERIALS shows it.
YOUNGS_MODULUS, POISSONS_RATIO = 1.0, 0.3
MATERIALS: dict[str, dict[str, float | str]] = {
    "E1e9": {"youngs_modulus": 1e9},
    "nu0": {"poissons_ratio": 0.0},
    "nu0.45": {"poissons_ratio": 0.45},
    "strain": {"state": "plane strain"},
    "strain-nu0.45": {"state": "plane strain", "poissons_ratio": 0.45},
}


def structure(
    element: str,
    squares: int = 1,
    pattern: DiagonalPattern = "right",
    youngs_modulus: float = YOUNGS_MODULUS,
    poissons_ratio: float = POISSONS_RATIO,
    state: str = "plane stress",
) -> Result:
    """Vertical reactions at the lower nodes of a row of unit squares, two triangles each."""

    def build(cell: str) -> Mesh:
        lower, upper, divisions = (0.0, 0.0), (float(squares), 1.0), (squares, 1)
        if cell == "quadrilateral":
            return quadrilaterals(MPI.COMM_SELF, lower, upper, divisions)
        return triangles(MPI.COMM_SELF, lower, upper, divisions, pattern)

    material = Material(youngs_modulus, poissons_ratio)
    body = discretise(element, build, material, StressState(state))
    K, U = body.K, body.space
    f = body.surface_load((0.0, -1.0), _upper_side)
    held = [prescribe(U, 1, _lower_side), prescribe(U, 0, _lower_left)]
    a = solve(K, f, body.supports(held))

    lower = forces_along(U, reactions(K, a, f), _lower_side)
    vertical = lower.force[:, 1]
    scalars = {f"reaction_{i}": float(r) for i, r in enumerate(vertical)}
    scalars["sum"] = float(vertical.sum())
    return Result(
        scalars,
        dict.fromkeys(scalars, UNSTATED.force),
        {"x": lower.position[:, 0], "reaction": vertical, **mesh_curves(U)},
        dofs=K.getSize()[0],
    )


def _upper_side(x: np.ndarray) -> np.ndarray:
    return np.isclose(x[1], 1.0)


def _lower_side(x: np.ndarray) -> np.ndarray:
    return np.isclose(x[1], 0.0)


def _lower_left(x: np.ndarray) -> np.ndarray:
    return np.isclose(x[1], 0.0) & np.isclose(x[0], 0.0)


# "If there are more than two elements located along the boundary surface": a row of six squares
VARIANTS: dict[str, dict[str, float | str]] = {
    "": {},
    "-left": {"pattern": "left"},
    "-row": {"squares": 6},
}
VARIANTS |= {f"-{name}": material for name, material in MATERIALS.items()}
CASES = [
    Case("7.1", element + suffix, structure, {"element": element, **parameters})
    for element in ("galerkin-T6", "pw-T6")
    for suffix, parameters in VARIANTS.items()
]
# The paper has two triangles here; the others show their nodal forces
CASES += [
    Case("7.1", element + suffix, structure, {"element": element, **VARIANTS[suffix]})
    for element in ("galerkin-Q8", "pw-Q8", "pw-Q9", "composite-T6")
    for suffix in ("", "-row")
]
