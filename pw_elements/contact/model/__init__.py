"""Input and results of contact computations: pairs, surfaces, friction laws, states, errors."""

from pw_elements.contact.model.errors import (
    ActiveSetCycling,
    ContactFailed,
    FreeBody,
    LastContactLost,
    LinearSolverFailed,
    LoadMissingForEquilibrium,
    NoEquilibrium,
    NotUnique,
    RigidVelocity,
    SolutionNotFound,
    SurfacePassed,
    describe_exhausted_friction,
)
from pw_elements.contact.model.friction import Coulomb, Friction, FrictionCone
from pw_elements.contact.model.history import (
    HistoryVariables,
    check_and_list_history_functions,
    make_update_from_expressions,
)
from pw_elements.contact.model.interface_laws import (
    CohesiveContact,
    ElasticInterface,
    Tie,
    UnilateralContact,
)
from pw_elements.contact.model.laws import (
    SNAP_BACK_EXPLANATION,
    InterfaceLaw,
    InterfaceLawEvaluation,
    InterfaceResponse,
    InterfaceValues,
    SofteningLaw,
    evaluate_and_check_shapes,
    find_wrong_derivatives,
)
from pw_elements.contact.model.pairs import ContactPair, DeformableSurface, MatchingNodes, Motion
from pw_elements.contact.model.state import (
    EMPTY_SOLVER_REPORT,
    ContactState,
    FreeMotionIndices,
    PairState,
    Residuals,
    ResidualScale,
    SmallDisplacementMeasures,
)
from pw_elements.contact.model.surfaces import (
    BUILT_IN_SURFACE_TYPES_WITH_CLOSEST_POINTS,
    CLOSED_FORM_SURFACE_TYPES,
    MAX_RELATIVE_GRADIENT_CHANGE_AT_HALF_STEP,
    SURFACE_TYPES_WITH_NORMAL_EVERYWHERE,
    ClosestPointSurface,
    FlatPunch,
    Parabola,
    Plane,
    SignedDistance,
    Sphere,
    Surface,
    describe_wrong_derivatives,
    measure_gradient_change_at_half_step,
    with_default_difference_step,
)
