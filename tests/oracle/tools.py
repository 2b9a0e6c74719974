"""Violations of the contact law by a rubber body under rigid planes and circles.

Tools move and rotate. A tool with the translation U and the angle a about its pivot c has moved its
points X to c + U + R (X - c), with R the rotation matrix. A node has moved to x = X + u, with u its
displacement. For a plane through p with the unit normal n and the tangent t, gap g and slip v are

    y = c + R^T (x - U - c),    g = n·(y - p),    v = t·(y - y_0),

with y_0 the value of y at the increment's start. For a circle of radius r with the moved centre m

    g = |x - m| - r,    v = r (change of the direction of x - m, less the change of a).

The slip is exact for any number of turns, since a node that touches a circle stays on its side. The
tool's forces on the surface are the nodal forces F_i(u). If a support holds a node along the
surface, however, F_i also contains the reaction of the support. At such nodes only the vertical
component is taken from F_i, and the horizontal one from the tool's force that the library reports.
As in `large`, the law for the normal force r_n, the tangential force r_t and the friction
coefficient mu is

    r_n >= 0,  g >= 0,  r_n g = 0;      |r_t| <= mu r_n,  |v| r_t + mu r_n v = 0.
"""

from dataclasses import dataclass

import numpy as np

from tests.oracle.large import NeoHookeanBody, contact_law_violations, cross_product_in_plane


@dataclass(frozen=True)
class RigidTool:
    """A rigid plane, or a rigid circle if the radius is not zero, at its initial position."""

    point: np.ndarray  # a point of the plane, or the centre of the circle
    normal: np.ndarray  # normal of the plane, into the body
    friction: float
    radius: float = 0.0
    pivot: np.ndarray = (0.0, 0.0)


@dataclass(frozen=True)
class ToolState:
    """A state of the library: displacements, and the tool's translation, angle and nodal forces."""

    displacement: np.ndarray  # (n, 2)
    translation: np.ndarray  # (2,)
    angle: float
    force: np.ndarray  # (n, 2), forces of the tool on the nodes; used at held nodes only


@dataclass(frozen=True)
class ToolContact:
    """A body and a tool, the nodes that may touch it, and the mask (n, 2) of supports."""

    body: NeoHookeanBody
    tool: RigidTool
    contact_nodes: np.ndarray
    prescribed_mask: np.ndarray

    def largest_violations_in_last_increment(
        self, history: list[ToolState], support_displacements: np.ndarray
    ) -> dict[str, float]:
        """Return each condition's largest violation in the last increment, by name.

        `support_displacements` are the prescribed displacements (n, 2), used at supports only.
        Forces and lengths are divided by the largest ones of the history. Contact nodes whose
        tangential motion a support prescribes have entries of their own, with the prefix "held ".
        """
        last_state = history[-1]
        force = max(np.abs(self.body.nodal_forces(state.displacement)).max() for state in history)
        length = max(
            np.abs(vector).max()
            for state in history
            for vector in (state.displacement, state.translation)
        )
        force = force if force > 1e-12 else 1.0  # the tool has not yet met the body
        forces = self.body.nodal_forces(last_state.displacement)
        r, is_held = forces[self.contact_nodes], self.prescribed_mask[self.contact_nodes, 0]
        r[is_held, 0] = last_state.force[self.contact_nodes[is_held], 0]
        free = ~self.prescribed_mask
        free[self.contact_nodes] = False
        gap, normal, slip = self._gaps_normals_and_slips(*history[-2:])
        support_error = np.abs(last_state.displacement - support_displacements)[
            self.prescribed_mask
        ]
        violations = {
            "supports": support_error.max(initial=0.0) / length,
            "equilibrium": np.abs(forces[free]).max(initial=0.0) / force,
        }
        r_n, r_t = np.sum(normal * r, axis=1) / force, cross_product_in_plane(normal.T, r.T) / force
        line_values = contact_law_violations(
            r_n, r_t, gap / length, slip / length, self.tool.friction
        )
        for name, values in line_values.items():
            for prefix, mask in (("", ~is_held), ("held ", is_held)):
                if mask.any():
                    violations[prefix + name] = max(0.0, float(values[mask].max()))
        return violations

    def _gaps_normals_and_slips(
        self, start_state: ToolState, end_state: ToolState
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return gaps (m,), normals (m, 2) and slips (m,) of the contact nodes."""
        tool, pivot = self.tool, np.array(self.tool.pivot)
        positions = [
            (self.body.nodes + state.displacement)[self.contact_nodes]
            for state in (start_state, end_state)
        ]
        rotations = [_rotation_matrix(state.angle) for state in (start_state, end_state)]
        if tool.radius:
            (d_0, d) = (
                x - (pivot + state.translation + R @ (tool.point - pivot))
                for x, state, R in zip(positions, (start_state, end_state), rotations, strict=True)
            )
            distance = np.linalg.norm(d, axis=1)
            angle_change = np.arctan2(cross_product_in_plane(d_0.T, d.T), np.sum(d_0 * d, axis=1))
            slip = tool.radius * (angle_change - (end_state.angle - start_state.angle))
            return distance - tool.radius, d / distance[:, None], slip
        y_0, y = (
            pivot + (x - state.translation - pivot) @ R
            for x, state, R in zip(positions, (start_state, end_state), rotations, strict=True)
        )
        tangent = np.array([-tool.normal[1], tool.normal[0]])
        normal = np.tile(rotations[1] @ tool.normal, (len(y), 1))
        return (y - tool.point) @ tool.normal, normal, (y - y_0) @ tangent


def _rotation_matrix(radians: float) -> np.ndarray:
    """Return the rotation matrix of an angle."""
    c, s = np.cos(radians), np.sin(radians)
    return np.array([[c, -s], [s, c]])
