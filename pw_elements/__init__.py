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

from pw_elements.algebra import (
    BucklingModes,
    NoModes,
    NotConverged,
    PetrovGalerkinProblem,
    Reduction,
    VibrationModes,
    buckling,
    critical_step,
    reactions,
    solve,
    symmetric_part,
    vibration_modes,
)
from pw_elements.checks import DegenerateMesh
from pw_elements.elasticity import (
    Body,
    BoundaryForces,
    Material,
    NodalFlux,
    Sibling,
    StressState,
    SurfaceNodes,
    boundary_measure,
    force_transfer,
    forces_along,
    lumped_mass,
    nodal_flux,
    nodal_load,
    prescribe,
)
from pw_elements.pictures import draw
from pw_elements.solvers import (
    Direct,
    Iterative,
    LinearSolver,
    SingularSystem,
    SolverNotConverged,
    SolverReport,
)
from pw_elements.spaces import (
    NumberingError,
    Spaces,
    as_function,
    assemble_matrix,
    assemble_scalar,
    assemble_vector,
    cell_measure,
    composite_element,
    macro_element,
    one_cut_element,
    quadratic_element,
    serendipity_element,
    split,
    test_space,
)

__all__ = [
    "Body",
    "BoundaryForces",
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
    "SurfaceNodes",
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
    "force_transfer",
    "forces_along",
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
