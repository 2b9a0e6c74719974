"""Quadratic finite elements with piecewise-linear weight functions, for DOLFINx.

The trial functions are the standard quadratic functions. The test (weight) functions are
continuous, and linear on the sub-cells of each cell refined once. The idea and the equations are
from M. Klisiński, Ch. Luo, E. Postek, "Discussion on application of piece-wise linear weight
functions in 2D contact problems" (2001). The space of the weight functions is the P1-iso-P2
element of M. Bercovier and O. Pironneau (1979), https://doi.org/10.1007/BF01399555.
"""

import re
from importlib import import_module
from importlib.util import find_spec

__version__ = "0.1.0"

if not find_spec("dolfinx") or re.match(r"0\.([0-8]|10)\.", import_module("dolfinx").__version__):
    raise ImportError(
        "pw_elements needs DOLFINx 0.9 or 0.11: use Debian's python3-dolfinx, conda-forge's "
        "fenics-dolfinx or the container dolfinx/dolfinx, or start through ./run, which fetches it"
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
    "lumped_mass",
    "nodal_flux",
    "prescribe",
    "reactions",
    "solve",
    "split",
    "test_space",
    "vibration_modes",
]
