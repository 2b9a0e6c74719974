"""Which refusal it is, when an increment's iteration has failed and nothing else has helped."""

from pw_elements.contact.errors import ContactFailed, NotFound, NotUnique
from pw_elements.contact.newton import Increment
from pw_elements.contact.results import contact_state
from pw_elements.contact.state import ContactState
from pw_elements.linear_solver import SolverReport


def refusal(
    failure: ContactFailed, increment: Increment, before: ContactState, report: SolverReport
) -> ContactFailed:
    """`NotUnique` if that is what the tangent showed, else `NotFound`; both with a state.

    Args:
        failure: of the iteration; no proof against an equilibrium has been found.
        increment: that failed.
        before: state at its start.
        report: what solved its linear systems in vain.
    """
    near = ""
    if increment.nearest is not None:
        now, violation = increment.nearest
        state = contact_state(increment, now, increment.systems, before, report, converged=False)
        near = f"the state that came nearest violates the law {violation:.1e} times the tolerance; "
    if not isinstance(failure, NotUnique):
        failure = NotFound(
            f"{failure}; {near}try smaller increments, to press before pushing, a start from the "
            "states of a smaller friction or of a coarser mesh"
        )
    if near:
        failure.state = state
    return failure
