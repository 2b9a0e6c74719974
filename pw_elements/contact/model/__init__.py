"""Input and results of contact computations: pairs, surfaces, friction laws, states, errors."""

from pw_elements.contact.model.errors import (
    ContactFailed,
    Cycling,
    FreeBody,
    LastContactLost,
    MissingForce,
    NoEquilibrium,
    NotFound,
    NotUnique,
    RigidVelocity,
    SurfacePassed,
    describe_exhausted_friction,
)
from pw_elements.contact.model.friction import Coulomb, Friction, FrictionCone
from pw_elements.contact.model.pairs import ContactPair, DeformableSurface, MatchingNodes, Motion
from pw_elements.contact.model.state import (
    NO_SOLVER_REPORT,
    ContactState,
    FreeMotions,
    PairState,
    Residuals,
    ResidualScale,
    Smallness,
)
from pw_elements.contact.model.surfaces import (
    BUILT_IN_CLOSEST_POINTS,
    CLOSED_FORM_SURFACES,
    MAX_DIFFERENCE_STEP_ERROR,
    SURFACES_DEFINED_EVERYWHERE,
    ClosestPointSurface,
    FlatPunch,
    Parabola,
    Plane,
    SignedDistance,
    Sphere,
    Surface,
    describe_wrong_derivatives,
    measure_difference_step_error,
    with_default_step,
)
