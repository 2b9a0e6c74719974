"""Contact points at nodes that belong to several contact pairs.

A node has one contact point for each of its pairs. The points of a node have the same position and
the same equations, so that these equations determine only the sum of their forces.
"""

from dataclasses import dataclass
from functools import cached_property
from itertools import combinations

from mpi4py import MPI

import numpy as np

from pw_elements.arrays import Array, Indices, Mask

# Smallest angle, in degrees, between the normal of a surface that acts on a node and the span of
# the normals of all other surfaces that act on the same node
MIN_DEGREES_BETWEEN_NORMALS = 1.0
_MIN_SINE_BETWEEN_NORMALS = float(np.sin(np.radians(MIN_DEGREES_BETWEEN_NORMALS)))


@dataclass(frozen=True)
class SharedNodes:
    """The contact points (m) of this process, grouped by node.

    Args:
        first_point: (m,), index of the first point at the node of each point.
        exist: whether a node of any process belongs to several pairs.
    """

    first_point: Indices
    exist: bool

    @classmethod
    def from_node_numbers(cls, node: Indices, comm: MPI.Comm) -> "SharedNodes":
        """Group points by the number (m,) of their node; collective."""
        _, first, group = np.unique(node, return_index=True, return_inverse=True)
        return cls(first[group], comm.allreduce(len(first) < len(node), MPI.LOR))

    @cached_property
    def is_additional(self) -> Mask:
        """Mask (m,) of all points except the first one at each node."""
        return np.asarray(self.first_point != np.arange(len(self.first_point)))

    @cached_property
    def is_shared(self) -> Mask:
        """Mask (m,) of all points whose node belongs to several pairs."""
        return np.isin(self.first_point, self.first_point[self.is_additional])

    @cached_property
    def points_of_each_node(self) -> list[Indices]:
        """Indices of the points at each node that belongs to several pairs."""
        points = np.flatnonzero(self.is_shared)
        points = points[np.argsort(self.first_point[points], kind="stable")]
        _, starts = np.unique(self.first_point[points], return_index=True)
        return np.split(points, starts[1:]) if len(points) else []

    def find_points_of_nodes_with_several(self, selected: Mask) -> Mask:
        """Return a mask (m,) of all points whose node has at least two of the selected points.

        Args:
            selected: (m,), mask of the selected points.
        """
        count = np.bincount(self.first_point[selected], minlength=len(self.first_point))
        return np.asarray(count[self.first_point] > 1)

    def subtract_additional_forces(self, node_force: Array, point_force: Array) -> Array:
        """Return the force (m, dim) of each point, given the total force of its node.

        Args:
            node_force: (m, dim), total contact forces of the nodes.
            point_force: (m, dim), forces of the points. The values at the first points of the nodes
                are not used.
        """
        force = node_force.copy()
        force[self.is_additional] = point_force[self.is_additional]
        np.subtract.at(force, self.first_point[self.is_additional], point_force[self.is_additional])
        return force

    def find_points_on_equal_surfaces(
        self, gap: Array, normal: Array, max_gap_difference: float
    ) -> Mask:
        """Return a mask (m,) of points with the gap and normal of an earlier point of their node.

        Args:
            gap: (m,), gaps.
            normal: (m, dim), unit normals. Normals are equal if the angle between them is less than
                `MIN_DEGREES_BETWEEN_NORMALS`.
            max_gap_difference: largest difference between equal gaps.
        """
        is_equal = np.zeros(len(gap), dtype=bool)
        for points in self.points_of_each_node:
            for one, other in combinations(points[np.isfinite(gap[points])], 2):
                cosine = normal[one] @ normal[other]
                sine = np.linalg.norm(normal[one] - cosine * normal[other])
                if cosine > 0 and sine < _MIN_SINE_BETWEEN_NORMALS:
                    is_equal[other] |= abs(gap[one] - gap[other]) <= max_gap_difference
        return is_equal

    def find_dependent_points(self, closed: Mask, normal: Array, priority: Array) -> Mask:
        """Return a mask (m,) of closed points whose normals depend on those of other closed points.

        The closed points of a node are examined in the order of decreasing priority. A normal
        counts as dependent if its angle with the span of the preceding independent normals is less
        than `MIN_DEGREES_BETWEEN_NORMALS`.

        Args:
            closed: (m,), mask of closed points.
            normal: (m, dim), unit normals.
            priority: (m,), priorities of the points.
        """
        dependent = np.zeros(len(closed), dtype=bool)
        for points in self.points_of_each_node:
            candidates = points[closed[points]]
            if len(candidates) < 2:
                continue
            basis = np.zeros((0, normal.shape[1]))
            for point in candidates[np.argsort(-priority[candidates], kind="stable")]:
                remainder = normal[point] - basis.T @ (basis @ normal[point])
                remainder -= basis.T @ (basis @ remainder)
                length = np.linalg.norm(remainder)
                if length < _MIN_SINE_BETWEEN_NORMALS:
                    dependent[point] = True
                else:
                    basis = np.vstack([basis, remainder / length])
        return dependent
