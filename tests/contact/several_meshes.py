"""Two blocks with a mesh each, which are pressed together and slid along each other."""

from mpi4py import MPI

import numpy as np
import ufl
from dolfinx import fem
from dolfinx.mesh import CellType, create_box, create_rectangle

from pw_elements import Body, Material, Spaces, prescribe
from pw_elements.contact import ContactPair, ContactProblem, DeformableSurface
from tests.contact.cases import make_finite_strain_unknown_and_residual, on_plane
from tests.contact.two_bodies import join_meshes

LOWER_BOX = ((-0.9, -0.7, -0.8), (0.9, 0.7, 0.0))
UPPER_BOX = ((-0.5, -0.4, 0.0), (0.3, 0.35, 0.6))


def make_block_mesh(box, divisions, cell, comm):
    """Return the mesh of a box in space, or of the section x_1 = 0 of a box in the plane."""
    if cell in ("triangle", "quadrilateral"):
        corners = [[corner[0], corner[2]] for corner in box]
        return create_rectangle(comm, corners, [divisions[0], divisions[2]], CellType[cell])
    return create_box(comm, box, divisions, CellType[cell])


class BlocksWithAMeshEach:
    """A lower block with a fixed base, and an upper block, the slave, whose top is moved.

    Args:
        cells: types of the cells of the lower and the upper block.
        divisions: numbers of cells of both blocks along the axes.
        boxes: opposite corners of both blocks; the lower one ends at z = 0.
        is_finite_strain: whether the bodies are neo-Hookean instead of linear elastic.
        is_in_one_mesh: whether both blocks are parts of one mesh, for comparison.
        upper_is_slave: whether the pair's nodes are those of the upper block.
        rollers: whether base and sides are planes of symmetry instead of a fixed base.
        friction: Coulomb's coefficient.
        gap: initial gap between the blocks.
        comm: communicator of the meshes.
        options: of the contact problem.
    """

    def __init__(
        self,
        cells=("hexahedron", "tetrahedron"),
        divisions=((3, 2, 2), (2, 2, 2)),
        boxes=(LOWER_BOX, UPPER_BOX),
        is_finite_strain=False,
        is_in_one_mesh=False,
        upper_is_slave=True,
        rollers=False,
        friction=0.3,
        gap=0.0,
        comm=MPI.COMM_SELF,
        **options,
    ):
        height = boxes[1][1][2]
        lower, upper = (
            make_block_mesh(box, n, cell, MPI.COMM_SELF if is_in_one_mesh else comm)
            for box, n, cell in zip(boxes, divisions, cells, strict=True)
        )
        self.dim = lower.geometry.dim
        self.up = self.dim - 1
        x = upper.geometry.x
        x[:, self.up] += gap * (1 - x[:, self.up] / height)
        self.meshes = [join_meshes(lower, upper, comm)] if is_in_one_mesh else [lower, upper]
        self.functions, self.residuals, self.spaces = [], [], []
        for mesh in self.meshes:
            spaces = Spaces.petrov_galerkin(mesh)
            state = "solid" if self.dim == 3 else "plane strain"
            if is_finite_strain:
                u, residual = make_finite_strain_unknown_and_residual(spaces, quadrature_degree=2)
            else:
                u = fem.Function(spaces.trial)
                residual = ufl.action(Body(spaces, Material(1.0, 0.3), state).stiffness(), u)
            self.spaces.append(spaces.trial)
            self.functions.append(u)
            self.residuals.append(residual)
        lower_space, upper_space = self.spaces[0], self.spaces[-1]
        self.translation = [fem.Constant(upper_space.mesh, 0.0) for _ in range(self.dim)]
        base, top = on_plane(self.up, boxes[0][0][2]), on_plane(self.up, height)
        if rollers:
            self.conditions = [prescribe(lower_space, self.up, base)]
            self.conditions += [prescribe(upper_space, self.up, top, self.translation[self.up])]
            self.conditions += [
                prescribe(space, i, on_plane(i, boxes[0][0][i]))
                for space in self.spaces
                for i in range(self.up)
            ]
        else:
            self.conditions = [prescribe(lower_space, i, base) for i in range(self.dim)]
            self.conditions += [
                prescribe(upper_space, i, top, self.translation[i]) for i in range(self.dim)
            ]
        sides = [on_plane(self.up, gap), on_plane(self.up, 0.0)]
        if not is_in_one_mesh:
            sides = list(zip((upper, lower), sides, strict=True))
        slave, master = sides if upper_is_slave else sides[::-1]
        surface = DeformableSurface(master, revolved=None if self.dim == 3 else False)
        self.pair = ContactPair(slave, surface, friction=friction)
        u, residual = (
            values[0] if is_in_one_mesh else values for values in (self.functions, self.residuals)
        )
        self.problem = ContactProblem.of_residual(
            residual, u, self.conditions, self.pair, **options
        )

    def move(self, path, state=None, start=None):
        """Return the states at the ends of the increments of a path of translations of the top.

        The path begins at a state where the top's translation is `start`, by default undeformed.
        """
        states = [state or self.problem.undeformed]
        for begin, end in zip((start or (0.0,) * self.dim, *path[:-1]), path, strict=True):

            def translate_top(load_factor, begin=begin, end=end):
                for constant, a, b in zip(self.translation, begin, end, strict=True):
                    constant.value = (1 - load_factor) * a + load_factor * b

            states.append(self.problem.step(states[-1], translate_top))
        return states[1:]


def forces_and_positions_of_both_sides(blocks, state):
    """Return contact forces (n, dim) on the nodes of both sides, and their deformed positions.

    For blocks on one process.
    """
    (pair,) = state.pairs
    nodes = np.concatenate([pair.node, pair.opposite_node])
    forces = np.concatenate(
        [pair.force_normal[:, None] * pair.normal + pair.force_tangential, pair.opposite_force]
    )
    x = np.concatenate(
        [space.tabulate_dof_coordinates()[:, : blocks.dim] for space in blocks.spaces]
    )
    displacement = state.displacement.array_r.reshape(-1, blocks.dim)
    return forces, (x + displacement)[nodes]
