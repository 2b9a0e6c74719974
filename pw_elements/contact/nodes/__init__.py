"""The contact nodes: law, active set and kinematics, undeformed, deformed and of two bodies."""

from pw_elements.contact.nodes.deformed import (
    DeformedKinematics,
    PairKinematics,
    RigidSurfaceMotion,
    RigidSurfacesOnly,
)
from pw_elements.contact.nodes.nodes import (
    HELD,
    OPEN,
    SLIP,
    STICK,
    TOLERANCE,
    ActiveSet,
    ContactNodes,
    LinearisedKinematics,
    LinearisedLaw,
    TorqueMap,
    assemble_node_equations,
    count_statuses,
    eliminate_known_motions,
    find_differences,
    is_same_set,
    linearise_friction_limits,
    make_sticking_set,
    rotate_to_frames,
    select_nodes,
)
from pw_elements.contact.nodes.sliding import MortarKinematics
from pw_elements.contact.nodes.undeformed import (
    IncrementStart,
    Kinematics,
    UndeformedKinematics,
    make_increment_start,
    remove_normal_part,
)
