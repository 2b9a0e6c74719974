"""Test the 8-node quadrilateral of section 5, two triangles without their inner node (Fig. 3).

The paper eliminates the inner node by static condensation in statics and by Guyan reduction in
eigenvalue problems. Guyan reduction is tested with the eigenvalues of section 7.5.
"""

import numpy as np
import pytest

from tests.oracle.assembly import LinearElasticBody
from tests.oracle.eigen import guyan_reduction


@pytest.mark.parametrize(("element", "oracle_element"), [("pw-Q8", "T6"), ("pw-Q9", "Q9")])
def test_oracle_agrees_on_unsymmetry_and_rank_of_one_condensed_element(
    element, oracle_element, results
):
    stored_result = results[f"5/element-{element}"]
    nodes, inner_node = stored_result.curves["nodes"], int(stored_result.curves["inner"])
    body = LinearElasticBody(
        nodes, stored_result.curves["cells"], oracle_element, True, "plane stress", 1.0, 0.3
    )
    K, _ = guyan_reduction(body.stiffness(), body.mass(), np.array([inner_node]))
    assert stored_result.scalars["unknowns"] == len(K) == 16
    assert stored_result.scalars["rigid_motions"] == 16 - np.linalg.matrix_rank(K, tol=1e-10) == 3
    unsymmetry = np.linalg.norm(K - K.T) / np.linalg.norm(K.T)
    assert stored_result.scalars["unsymmetry"] == pytest.approx(unsymmetry, rel=1e-9)
