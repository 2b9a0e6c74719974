"""Quadratic finite elements with piecewise-linear weight functions, for DOLFINx.

The trial functions are the standard quadratic ones; the test (weight) functions are
continuous and linear on the sub-cells of the once refined cell. Idea and equations:
M. Klisiński, Ch. Luo, E. Postek, "Discussion on application of piece-wise linear weight
functions in 2D contact problems" (2001); as a function space it is the P1-iso-P2 element
of M. Bercovier and O. Pironneau (1979), https://doi.org/10.1007/BF01399555.
"""

from importlib.util import find_spec

__version__ = "0.1.0"

if find_spec("dolfinx") is None:
    raise ImportError(
        "pw_elements needs DOLFINx 0.9 or newer: use Debian's python3-dolfinx, conda-forge's "
        "fenics-dolfinx or the container dolfinx/dolfinx, or start through ./run, which fetches it"
    )

from pw_elements._compat import renamed
from pw_elements.algebra import SingularSystem, reactions, solve, symmetric_part
from pw_elements.assembly import assemble_matrix, assemble_scalar, assemble_vector
from pw_elements.eigen import BucklingModes, NoModes, VibrationModes, buckling, vibration_modes
from pw_elements.elements import (
    composite_element,
    macro_element,
    one_cut_element,
    quadratic_element,
    serendipity_element,
)
from pw_elements.fluxes import NodalFlux, nodal_flux
from pw_elements.iterative import Iterative
from pw_elements.linear_solver import Direct, LinearSolver, SolverNotConverged, SolverReport
from pw_elements.mechanics import (
    Body,
    Material,
    StressState,
    boundary_measure,
    lumped_mass,
    nodal_load,
    prescribe,
)
from pw_elements.mesh_checks import DegenerateMesh
from pw_elements.pictures import draw
from pw_elements.problems import PetrovGalerkinProblem
from pw_elements.quadrature import cell_measure
from pw_elements.reduction import Reduction
from pw_elements.sibling import Sibling
from pw_elements.snes import NotConverged
from pw_elements.spaces import NumberingError, Spaces, as_function, split, test_space
from pw_elements.stability import critical_step

__all__ = [
    "Body",
    "BucklingModes",
    "DegenerateMesh",
    "Direct",
    "Iterative",
    "LinearSolver",
    "Material",
    "NoModes",
    "NodalFlux",
    "NotConverged",
    "NumberingError",
    "PetrovGalerkinProblem",
    "Reduction",
    "Sibling",
    "SingularSystem",
    "SolverNotConverged",
    "SolverReport",
    "Spaces",
    "StressState",
    "VibrationModes",
    "as_function",
    "assemble_matrix",
    "assemble_scalar",
    "assemble_vector",
    "boundary_measure",
    "buckling",
    "cell_measure",
    "composite_element",
    "critical_step",
    "draw",
    "lumped_mass",
    "macro_element",
    "nodal_flux",
    "nodal_load",
    "one_cut_element",
    "prescribe",
    "quadratic_element",
    "reactions",
    "serendipity_element",
    "solve",
    "split",
    "symmetric_part",
    "test_space",
    "vibration_modes",
]

__getattr__ = renamed(
    __name__,
    {
        "State": ("StressState", StressState),
        "frequencies": ("vibration_modes", vibration_modes),
        "support": ("prescribe", prescribe),
    },
)
