"""The linear system of an active set, solved by factorisation or by a matrix-free Krylov method."""

from pw_elements.contact.system.assembled import (
    AssembledTangent,
    extract_local_rows,
    make_map_from_free_motions_to_points,
)
from pw_elements.contact.system.interfaces import Equilibrium
from pw_elements.contact.system.solution import ContactSystemSolution, LinearSolveAccuracy
from pw_elements.contact.system.system import (
    NO_COST,
    ContactSystem,
    SolveCountAndReport,
    measure_cost,
)
