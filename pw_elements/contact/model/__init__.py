"""What is stated of contact and what comes back: pairs, surfaces, states, errors."""

from pw_elements.contact.model.errors import (
    ContactFailed,
    Cycling,
    FreeBody,
    LostHold,
    MissingForce,
    NoEquilibrium,
    NotFound,
    NotUnique,
    RigidVelocity,
    SurfacePassed,
    exhausted_friction,
)
from pw_elements.contact.model.friction import Cone, Coulomb, Friction
from pw_elements.contact.model.pairs import ContactPair, DeformableSurface, MatchingNodes, Motion
from pw_elements.contact.model.state import (
    NOTHING_DONE,
    ContactState,
    Free,
    PairState,
    Residuals,
    Scale,
    Smallness,
)
from pw_elements.contact.model.surfaces import (
    CLOSED_FORMS,
    DEFINED_EVERYWHERE,
    KNOWN_BODIES,
    MAX_STEP_ERROR,
    FlatPunch,
    Parabola,
    Plane,
    RigidBody,
    SignedDistance,
    Sphere,
    Surface,
    step_error,
    with_step,
    wrong_derivatives,
)
