"""Line search for materials with memory, by the restricted monotonicity test.

In plastic flow the tangent changes by orders of magnitude from one iterate to the next, and full
Newton steps overshoot. A residual norm is no good measure of progress there, because stresses
saturate at the yield limit while displacements are still wrong by a multiple, and because it adds
forces to the residuals of gaps and slips. The merit function is therefore Deuflhard's natural level
function, the norm of the simplified Newton correction

    |d(a)|,    J d(a) = -F(u_k + a s),    J s = -F(u_k),

where J contains the tangent, and the rows of the contact law for the active set, at the iterate
u_k, and where F contains the residual and the violation of the (semismooth) contact law. It is a
displacement and does not depend on how the rows of F are scaled. A step of length a is accepted if

    |d(a)| <= (1 - a/4) |s|

(P. Deuflhard, Newton Methods for Nonlinear Problems, Springer 2004, section 3.3). Each test
needs a residual and a solution with factors that are already there.
"""

from dataclasses import replace

import numpy as np

from pw_elements.contact.iteration.finite import LargeStrainEquilibrium
from pw_elements.contact.iteration.increment import IncrementEquations
from pw_elements.contact.iteration.increment_data import LinearisedIncrement, NewtonIterate
from pw_elements.contact.system import ContactSystemSolution

# Largest number of halvings of a step that fails the test
_MAX_HALVINGS_BY_MONOTONICITY_TEST = 5
# Required decrease of the merit function for a step of length 1, relative to its value
_REQUIRED_RELATIVE_DECREASE = 0.25


class LineSearchIncrementEquations(IncrementEquations):
    """Equations of an increment whose Newton steps are shortened by the monotonicity test.

    Steps that first reach the prescribed displacements are not shortened, and after
    `_MAX_HALVINGS_BY_MONOTONICITY_TEST` halvings a step is taken as it is.
    """

    equilibrium: LargeStrainEquilibrium

    def choose_next_iterate(
        self, linear_system: LinearisedIncrement, solution: ContactSystemSolution
    ) -> NewtonIterate:
        """Return the first iterate along the step that passes the monotonicity test."""
        is_supported = self.equilibrium.satisfies_supports
        state = self.move_and_evaluate(linear_system, solution)
        full_step = self.equilibrium.norm_of_displacement_change(
            solution.reduced_unknowns, from_linearisation_point=True
        )
        for _ in range(_MAX_HALVINGS_BY_MONOTONICITY_TEST if is_supported else 0):
            limit = (1 - _REQUIRED_RELATIVE_DECREASE * state.step_length) * full_step
            if state.violation <= 1 or self._simplified_correction(linear_system, state) <= limit:
                break
            state = self.move_and_evaluate(linear_system, solution, state.step_length / 2)
        return state

    def _simplified_correction(
        self, linear_system: LinearisedIncrement, state: NewtonIterate
    ) -> float:
        """Return the norm of the simplified Newton correction at an iterate."""
        law = linear_system.law
        violation = np.einsum("nab,na->nb", state.kinematics.frame, state.nodes.law_violation())
        v = self.system.evaluate_point_motions(state.unknowns) - linear_system.known_v
        q = state.q[self.interface.pair] - linear_system.known_q
        c = np.einsum("nab,nb->na", law.E, state.force) + np.einsum("nab,nb->na", law.C, v)
        c -= np.einsum("nab,nb->na", law.D, q) + violation
        self.system.set_initial_iterate(lambda: state.unknowns, state.q)
        corrected = self.system.solve_with_last_matrix(
            self.equilibrium.linearise_load_at_iterate(),
            replace(law, c=c),
            linear_system.totals,
            torque_map=linear_system.torque_map,
            accuracy="rough",
            friction_springs=linear_system.springs,
        )
        return self.equilibrium.norm_of_displacement_change(corrected.reduced_unknowns)
