"""Meshes of the blocks of section V18, and errors of nodal forces of its patch.

Unlike the other modules on CalculiX, this one needs DOLFINx.
"""

from collections.abc import Sequence

import numpy as np
from dolfinx.mesh import Mesh
from scipy.spatial.transform import Rotation

from pw_elements.contact.model import ContactState, PairState
from study.meshes.two_body_meshes import mesh_two_blocks_in_space
from study.solutions.calculix.blocks_in_space import (
    GAP,
    PATCH_GRIDS,
    Indices,
    RotatedPatch,
    exact_patch_normals_and_pressures,
    rotate_about_general_axis,
)
from study.solutions.calculix.grids import Grid
from study.solutions.calculix.output import Array
from study.solutions.rubber import NeoHookeanBody, compare_force_over_weight

QUADRATURE_DEGREE = 2  # of both programs


def mesh_blocks(
    grids: Sequence[Grid], curvatures: tuple[float, float], cell: str = "tetrahedron"
) -> tuple[Mesh, tuple[Indices, Indices]]:
    """Mesh two blocks; return the mesh, and the facets of the slave (upper) and of the master.

    Args:
        grids: Grids of the lower and the upper block.
        curvatures: Curvatures of the lower block's upper side and of the upper block's lower side.
        cell: "tetrahedron" or "hexahedron".
    """
    lower, upper = (
        [
            np.linspace(*ends[:2], ends[2] + 1)
            for ends in zip(g.lower, g.upper, g.divisions, strict=True)
        ]
        for g in grids
    )
    return mesh_two_blocks_in_space(cell, lower, upper, curvatures, GAP)


def compare_patch_with_exact(
    bodies: NeoHookeanBody,
    sides: tuple[Indices, Indices],
    state: ContactState,
    curvature: float,
    lame: float | None,
    degrees: float,
) -> tuple[dict[str, float], dict[str, Array]]:
    """Compare nodal forces of the pressed patch on both sides with uniaxial stress.

    Args:
        bodies: Both blocks.
        sides: Facets of the slave and of the master.
        state: State of the patch.
        curvature: Curvature of the common side.
        lame: Argument of `solve_uniaxial_stress`.
        degrees: Angle by which the blocks are rotated.

    Returns:
        Errors of force over weight; undeformed positions, normal forces, integrals of weights, and
        exact pressures of the nodes; names of the master end in "_master".
    """
    bodies.solution.x.array[:] = state.displacement.array_r
    weight = bodies.integrate_weights_over_deformed_sides(sides)
    pair, rotation = state.pairs[0], rotate_about_general_axis(degrees)
    scalars: dict[str, float] = {}
    curves: dict[str, Array] = {}
    for side, node, force in (
        ("", pair.node, -pair.force_vector),
        ("_master", pair.opposite_node, pair.opposite_force),
    ):
        normal, exact = exact_patch_normals_and_pressures(bodies.x[node], curvature, lame)
        normal_force = -np.sum(force * rotation.apply(normal), axis=1)
        errors = compare_force_over_weight(normal_force, weight[node], exact)
        scalars |= {name + side: value for name, value in errors.items()}
        curves |= {f"x{side}": bodies.x[node, :2], f"force{side}": normal_force}
        curves |= {f"weight{side}": weight[node], f"exact{side}": exact}
    return scalars, curves


def compare_calculix_nodal_forces_with_exact(
    problem: RotatedPatch, displacement: Array
) -> dict[str, float]:
    """Return errors of the forces of the standard element on the slave of the pressed patch.

    Args:
        problem: Problem that CalculiX has solved.
        displacement: Displacements (3 k,) of its `nodes_of_elements_at_contact`.
    """
    mesh, sides = mesh_blocks(PATCH_GRIDS, problem.curvatures)
    bodies = NeoHookeanBody("galerkin-T10", mesh, QUADRATURE_DEGREE, calculix_energy=True)
    moved, slave = problem.nodes_of_elements_at_contact - 1, problem.slave_nodes - 1
    u = bodies.solution.x.array.reshape(-1, 3)
    u[bodies.find_nodes(problem.nodes[moved])] = displacement.reshape(-1, 3)
    node = bodies.find_nodes(problem.nodes[slave])
    normal, exact = exact_patch_normals_and_pressures(bodies.x[node], problem.curvature, None)
    force = np.sum(bodies.nodal_forces()[node] * normal, axis=1)
    weight = bodies.integrate_weights_over_deformed_sides(sides)[node]
    return compare_force_over_weight(force, weight, exact)


def measure_change_by_rotation(before: PairState, after: PairState, rotation: Rotation) -> float:
    """Return the largest change of forces, over the largest force, and of gaps, over `GAP`."""
    changes = [
        rotation.inv().apply(after.force_vector) - before.force_vector,
        rotation.inv().apply(after.opposite_force) - before.opposite_force,
    ]
    largest = np.abs(before.force_vector).max()
    gap_change = np.abs(after.gap - before.gap).max() / GAP
    return float(max(gap_change, *(np.abs(change).max() / largest for change in changes)))
