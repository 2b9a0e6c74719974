"""Elastic bodies, forces on their surfaces, and the symmetric sibling."""

from pw_elements.elasticity.body import (
    Body,
    Material,
    StressState,
    Vector,
    boundary_measure,
    lumped_mass,
    nodal_load,
    prescribe,
)
from pw_elements.elasticity.forces import (
    BoundaryForces,
    NodalFlux,
    SurfaceNodes,
    by_position,
    facet_nodes,
    facets_between,
    facets_in_cells,
    force_transfer,
    forces_along,
    nodal_flux,
)
from pw_elements.elasticity.incompressibility import REMEDY, TangentWatch
from pw_elements.elasticity.sibling import Sibling
