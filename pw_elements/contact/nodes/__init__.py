"""Contact nodes: contact law, active set, and kinematics of undeformed and deformed bodies."""

from pw_elements.contact.nodes.deformed import (
    DeformablePairKinematics,
    LargeStrainKinematics,
    NoDeformablePairs,
    RigidSurfaceMotion,
)
from pw_elements.contact.nodes.frames import make_frames
from pw_elements.contact.nodes.law_derivatives import (
    assemble_force_derivatives_by_fields,
    read_interface_fields,
)
from pw_elements.contact.nodes.law_nodes import (
    InterfaceLawNodes,
    evaluate_laws_that_hold_free_surfaces,
    stiffness_ratio,
)
from pw_elements.contact.nodes.nodes import (
    HELD,
    MAX_CONTACT_VIOLATION_PER_NODAL_FORCE,
    OPEN,
    SLIP,
    STICK,
    ActiveSet,
    ContactNodes,
    LinearisedContactLaw,
    LinearisedInterfaceLaw,
    LinearisedKinematics,
    TorqueMap,
    assemble_active_set_equations,
    combine_active_sets,
    describe_status_counts,
    eliminate_known_motions,
    find_differing_nodes,
    is_same_set,
    linearise_friction_limits,
    make_sticking_active_set,
    rotate_active_set,
)
from pw_elements.contact.nodes.shared_friction import FrictionAtSharedNodes
from pw_elements.contact.nodes.sliding import MortarKinematics
from pw_elements.contact.nodes.undeformed import (
    ContactKinematics,
    IncrementStart,
    SmallStrainKinematics,
    make_increment_start,
    remove_normal_part,
)
