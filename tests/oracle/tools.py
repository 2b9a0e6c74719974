"""Rigid planes and circles that move and turn on a rubber body: what a state of theirs violates.

A tool at a translation U and an angle a about its pivot c has moved its points X to
c + U + R (X - c). With a node's place x = X + u, of a plane through p with the unit normal n

    y = c + R^T (x - U - c),    g = n·(y - p),    v = t·(y - y_0),

y_0 being y at the increment's start. Of a circle with the moved centre m and the radius R

    g = |x - m| - R,    v = R (change of the direction of x - m, less the change of a),

which is exact for any number of turns, since a node that touches a circle stays on its side. At
the surface's nodes F_i(u) is the tool's force r. Where a support holds a node along the surface
F_i has the reaction, too: r is the force that the library reports, of which F_i has the normal
part. Then, as in `large`,

    r_n >= 0,  g >= 0,  r_n g = 0;      |r_t| <= mu r_n,  |v| r_t + mu r_n v = 0.
"""

from dataclasses import dataclass

import numpy as np

from tests.oracle.large import NeoHookeanBody, cross_product, law_violations


@dataclass(frozen=True)
class RigidTool:
    """A plane, or a circle where it has a radius, outside of a body, at its initial place."""

    point: np.ndarray  # of the plane, or the circle's centre
    normal: np.ndarray  # of the plane, into the body
    friction: float
    radius: float = 0.0
    pivot: np.ndarray = (0.0, 0.0)


@dataclass(frozen=True)
class ToolState:
    """What the library tells of one moment of a history."""

    displacement: np.ndarray  # (n, 2)
    translation: np.ndarray  # (2,)
    angle: float
    force: np.ndarray  # of the tool on the nodes, (n, 2), which only held nodes need


@dataclass(frozen=True)
class ToolContact:
    """A body under a tool, the nodes that may touch it, the mask (n, 2) of supports."""

    body: NeoHookeanBody
    tool: RigidTool
    contact_nodes: np.ndarray
    prescribed_mask: np.ndarray

    def violations(self, history: list[ToolState], prescribed: np.ndarray) -> dict[str, float]:
        """Of each condition in the last increment; of forces and lengths over history's largest.

        `prescribed` are the displacements (n, 2) that supports ask for. Conditions at nodes whose
        tangential motion a support prescribes have names of their own.
        """
        now = history[-1]
        force = max(np.abs(self.body.nodal_forces(moment.displacement)).max() for moment in history)
        length = max(
            np.abs(part).max() for one in history for part in (one.displacement, one.translation)
        )
        force = force if force > 1e-12 else 1.0  # the tool has not yet met the body
        forces = self.body.nodal_forces(now.displacement)
        r, held = forces[self.contact_nodes], self.prescribed_mask[self.contact_nodes, 0]
        r[held, 0] = now.force[self.contact_nodes[held], 0]
        free = ~self.prescribed_mask
        free[self.contact_nodes] = False
        gap, normal, slip = self._kinematics(*history[-2:])
        lost = np.abs(now.displacement - prescribed)[self.prescribed_mask]
        found = {
            "supports": lost.max(initial=0.0) / length,
            "equilibrium": np.abs(forces[free]).max(initial=0.0) / force,
        }
        r_n, r_t = np.sum(normal * r, axis=1) / force, cross_product(normal.T, r.T) / force
        lines = law_violations(r_n, r_t, gap / length, slip / length, self.tool.friction)
        for name, line in lines.items():
            for kind, which in (("", ~held), ("held ", held)):
                if which.any():
                    found[kind + name] = max(0.0, float(line[which].max()))
        return found

    def _kinematics(
        self, before: ToolState, now: ToolState
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        tool, pivot = self.tool, np.array(self.tool.pivot)
        places = [(self.body.nodes + one.displacement)[self.contact_nodes] for one in (before, now)]
        turns = [_rotation_matrix(one.angle) for one in (before, now)]
        if tool.radius:
            (d_0, d) = (
                x - (pivot + one.translation + R @ (tool.point - pivot))
                for x, one, R in zip(places, (before, now), turns, strict=True)
            )
            size = np.linalg.norm(d, axis=1)
            turned = np.arctan2(cross_product(d_0.T, d.T), np.sum(d_0 * d, axis=1))
            slip = tool.radius * (turned - (now.angle - before.angle))
            return size - tool.radius, d / size[:, None], slip
        y_0, y = (
            pivot + (x - one.translation - pivot) @ R
            for x, one, R in zip(places, (before, now), turns, strict=True)
        )
        tangent = np.array([-tool.normal[1], tool.normal[0]])
        normal = np.tile(turns[1] @ tool.normal, (len(y), 1))
        return (y - tool.point) @ tool.normal, normal, (y - y_0) @ tangent


def _rotation_matrix(angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s], [s, c]])
