"""Mortar integrals between the boundary facets of two bodies, whose meshes need not match."""

from pw_elements.contact.interface.mortars.boundary_facets import (
    BoundaryFacets,
    compute_facet_nodes_positions_and_facet_normals,
    gather_boundary_facets,
    gather_boundary_facets_of_bodies,
    integrate_outward_normals,
)
from pw_elements.contact.interface.mortars.facing import MortarMatrices, measure_gap_and_slip
from pw_elements.contact.interface.mortars.overlap import compute_cell_lengths_or_areas
from pw_elements.contact.interface.mortars.overlap_quadrature import (
    OverlapQuadrature,
    compute_tributary_areas,
)
from pw_elements.contact.interface.mortars.plane import PlaneSlidingMortar
from pw_elements.contact.interface.mortars.sliding import (
    N_SLIP_PATH_PIECES,
    MortarSlipReference,
    SlidingMortar,
    rotate_with_normal,
)
from pw_elements.contact.interface.mortars.space import SpaceSlidingMortar
