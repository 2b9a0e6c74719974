"""Elastic bodies, forces on their surfaces, and the symmetric standard element with even forces."""

from pw_elements.elasticity.axisymmetry import (
    is_axisymmetric_residual,
    is_axisymmetric_stiffness,
)
from pw_elements.elasticity.body import Body, StressState, VectorCoefficient, lumped_mass
from pw_elements.elasticity.boundary import boundary_measure, nodal_load, prescribe
from pw_elements.elasticity.forces import (
    BoundaryForces,
    NodalFlux,
    SurfaceNodes,
    exterior_facets_of_bodies_with_all_nodes,
    exterior_facets_with_all_nodes,
    facet_nodes,
    force_transfer,
    forces_along,
    locate_facet_nodes_in_cells,
    mark_boundary_nodes,
    nodal_flux,
    order_by_position,
)
from pw_elements.elasticity.incompressibility import (
    SINGULAR_STIFFNESS_WARNING_AND_REMEDY,
    TangentBulkShearMonitor,
)
from pw_elements.elasticity.material import Material
from pw_elements.elasticity.sibling import Sibling
