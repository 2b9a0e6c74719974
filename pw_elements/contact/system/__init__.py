"""The linear system of an active set, solved by factorisation or by a matrix-free Krylov method."""

from pw_elements.contact.system.assembled import (
    AssembledTangent,
    extract_local_rows,
    make_border_columns,
)
from pw_elements.contact.system.solution import Accuracy, Solution
from pw_elements.contact.system.system import NO_COST, ContactSystem, Cost, measure_cost
