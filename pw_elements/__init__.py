"""Quadratic finite elements with piecewise-linear weight functions, for DOLFINx.

The trial functions are the standard quadratic functions. The test (weight) functions are
continuous, and linear on the sub-cells of each cell refined once. The idea and the equations are
from M. Klisiński, Ch. Luo, E. Postek, "Discussion on application of piece-wise linear weight
functions in 2D contact problems" (2001). The space of the weight functions is the P1-iso-P2
element of M. Bercovier and O. Pironneau (1979), https://doi.org/10.1007/BF01399555.
"""

import sys
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

__version__ = "0.1.0"


def _find_dolfinx_problem() -> str | None:
    """Import DOLFINx; return why this library cannot use it, or None.

    pip cannot provide DOLFINx, petsc4py and slepc4py on every system. They are therefore not in the
    metadata of this package.
    """
    required = ("dolfinx", "petsc4py", "slepc4py")
    files = {
        name: Path(spec.origin)
        for name in (*required, "dolfinx_solver")
        if (spec := find_spec(name)) and spec.origin
    }
    if missing := [name for name in required if name not in files]:
        return f"has no {', '.join(missing)}"
    # DOLFINx of the PyPI package dolfinx-solver-real finds its MPI only if `dolfinx_solver` is
    # imported first; a DOLFINx in another folder does not belong to that package
    solver = files.get("dolfinx_solver")
    if solver and solver.parents[1] == files["dolfinx"].parents[1]:
        import_module("dolfinx_solver")
    dolfinx = import_module("dolfinx")
    if dolfinx.__version__.split(".")[:2] not in (["0", "9"], ["0", "11"]):
        return f"has DOLFINx {dolfinx.__version__}"
    if not dolfinx.common.has_petsc4py:
        return "has a DOLFINx without PETSc"
    if dolfinx.default_scalar_type.__name__ != "float64":
        return f"has a PETSc whose numbers are {dolfinx.default_scalar_type.__name__}"
    return None


if _dolfinx_problem := _find_dolfinx_problem():
    raise ImportError(
        "pw_elements needs DOLFINx 0.9 or 0.11 with petsc4py, slepc4py and real numbers (float64), "
        f"and {sys.executable} {_dolfinx_problem}. Choose one source: "
        "pip install 'dolfinx-solver-real>=0.11.0.post0,<0.12' (Linux, Python 3.12 or newer); "
        "conda install -c conda-forge fenics-dolfinx=0.9 slepc4py; "
        "apt install python3-dolfinx (Debian 13); the container dolfinx/dolfinx:v0.9.0; "
        "or start through ./run, which fetches it"
    )

from pw_elements.algebra import (
    PetrovGalerkinProblem,
    Reduction,
    TooFewModes,
    buckling,
    critical_step,
    reactions,
    solve,
    vibration_modes,
)
from pw_elements.elasticity import (
    Body,
    Material,
    Sibling,
    SurfaceNodes,
    boundary_measure,
    force_transfer,
    forces_along,
    lumped_mass,
    nodal_flux,
    prescribe,
)
from pw_elements.pictures import draw
from pw_elements.solvers import Direct, Iterative, NotConverged, SingularSystem
from pw_elements.spaces import (
    Spaces,
    as_function,
    assemble_matrix,
    assemble_scalar,
    assemble_vector,
    cell_measure,
    history_space,
    split,
    test_space,
)

__all__ = [
    "Body",
    "Direct",
    "Iterative",
    "Material",
    "NotConverged",
    "PetrovGalerkinProblem",
    "Reduction",
    "Sibling",
    "SingularSystem",
    "Spaces",
    "SurfaceNodes",
    "TooFewModes",
    "as_function",
    "assemble_matrix",
    "assemble_scalar",
    "assemble_vector",
    "boundary_measure",
    "buckling",
    "cell_measure",
    "critical_step",
    "draw",
    "force_transfer",
    "forces_along",
    "history_space",
    "lumped_mass",
    "nodal_flux",
    "prescribe",
    "reactions",
    "solve",
    "split",
    "test_space",
    "vibration_modes",
]
