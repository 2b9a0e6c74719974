"""Two neo-Hookean blocks in space that are pressed together and slid along each other."""

from mpi4py import MPI

import numpy as np
from dolfinx import fem
from dolfinx.mesh import CellType, create_box, create_mesh

from pw_elements import Body, Material, Spaces, prescribe
from pw_elements._compat import cell_geometry_nodes
from pw_elements.contact import ContactPair, ContactProblem, DeformableSurface
from pw_elements.spaces import is_hybrid
from tests.contact.cases import make_finite_strain_unknown_and_residual, on_plane
from tests.contact.two_bodies import join_meshes

INITIAL_GAP = 0.01
# Translations of the upper block's top at the ends of the increments, by less and by more than a
# cell
BLOCK_PATH = [(0.0, 0.0, -0.06), (0.08, 0.0, -0.06), (0.3, 0.1, -0.06)]


def add_mirror_image(mesh, axis):
    """Return a mesh together with its mirror image, joined at the plane where x[axis] is zero."""
    x, cells = mesh.geometry.x, cell_geometry_nodes(mesh)
    image_x = x * np.where(np.arange(3) == axis, -1.0, 1.0)
    beside = ~np.isclose(x[:, axis], 0.0)
    number = np.where(beside, len(x) + np.cumsum(beside) - 1, np.arange(len(x)))
    return create_mesh(
        MPI.COMM_SELF,
        cells=np.concatenate([cells, number[cells]]).astype(np.int64),
        x=np.concatenate([x, image_x[beside]]),
        e=mesh.ufl_domain().ufl_coordinate_element(),
    )


class BlocksInSpace:
    """A block with a fixed base, and a smaller block above it whose top is moved.

    The lower block's top is at z = 0. The upper block's lower side is INITIAL_GAP above it, at
    z = INITIAL_GAP + `crown` (x^2 + y^2); it is the slave unless `upper_is_slave` is false.
    Components of displacements are zero on the planes of symmetry x_i = 0, where i are the
    `symmetry_axes`.

    Args:
        divisions: numbers of cells of the lower and the upper block along the axes.
        boxes: opposite corners of the lower and the upper block, the latter above z = 0.
        mirror_axes: axes i such that both blocks are completed by their mirror images at x_i = 0.
        element: name of the method of `Spaces`.
        compressibility: that of hybrid bodies.
        options: of the contact problem.
    """

    def __init__(
        self,
        divisions=((4, 3, 1), (2, 2, 1)),
        boxes=(((-0.9, -0.7, -0.5), (0.9, 0.7, 0.0)), ((-0.5, -0.4, 0.0), (0.3, 0.35, 0.5))),
        crown=0.1,
        friction=0.3,
        upper_is_slave=True,
        mirror_axes=(),
        element="petrov_galerkin",
        compressibility=0.0,
        symmetry_axes=(),
        cell=CellType.tetrahedron,
        comm=MPI.COMM_SELF,
        **options,
    ):
        lower, upper = (
            create_box(MPI.COMM_SELF, box, n, cell) for box, n in zip(boxes, divisions, strict=True)
        )
        height = boxes[1][1][2]
        self.crown, x = crown, upper.geometry.x
        x[:, 2] += self._bottom_height(x.T) * (1 - x[:, 2] / height)
        for axis in mirror_axes:
            lower, upper = (add_mirror_image(mesh, axis) for mesh in (lower, upper))
        self.mesh = join_meshes(lower, upper, comm)
        spaces = getattr(Spaces, element)(self.mesh)
        self.body = Body(spaces, Material(1.0, 0.5 if element == "hybrid" else 0.3), "solid")
        self.space = spaces.trial
        self.u, self.residual = make_finite_strain_unknown_and_residual(
            spaces, quadrature_degree=2, compressibility=compressibility
        )
        self.translation = [fem.Constant(self.mesh, 0.0) for _ in range(3)]
        base, top = on_plane(2, boxes[0][0][2]), on_plane(2, height)
        # planes of symmetry first: a condition that comes later replaces earlier ones
        self.conditions = [prescribe(self.space, i, on_plane(i, 0.0)) for i in symmetry_axes]
        self.conditions += [prescribe(self.space, i, base) for i in range(3)]
        self.conditions += [prescribe(self.space, i, top, self.translation[i]) for i in range(3)]
        sides = self.on_upper_bottom, on_plane(2, 0.0)
        slave, master = sides if upper_is_slave else sides[::-1]
        self.pair = ContactPair(slave, DeformableSurface(master), friction=friction)
        self.options = options

    @property
    def problem(self):
        """Return the contact problem, made on first use."""
        if not hasattr(self, "_problem"):
            self._problem = self.make_problem()
        return self._problem

    @property
    def owned_positions(self):
        """Return the undeformed positions (n, 3) of the nodes of this process."""
        space = self.space.sub(0).collapse()[0] if is_hybrid(self.space) else self.space
        return space.tabulate_dof_coordinates()[: space.dofmap.index_map.size_local]

    def make_problem(self, pair=None, **options):
        return ContactProblem.of_residual(
            self.residual, self.u, self.conditions, pair or self.pair, **self.options, **options
        )

    def on_upper_bottom(self, x):
        near = np.abs(x[2] - self._bottom_height(x)) < 0.05
        return (x[2] > INITIAL_GAP / 2) & near

    def _bottom_height(self, x):
        return INITIAL_GAP + self.crown * (x[0] ** 2 + x[1] ** 2)

    def slide(self, path=BLOCK_PATH, start_state=None, start=(0.0, 0.0, 0.0)):
        """Return the states at the ends of the increments of a path of translations of the top.

        The path begins at a state where the top's translation is `start`, by default undeformed.
        """
        states = [start_state or self.problem.undeformed]
        for begin, end in zip((start, *path[:-1]), path, strict=True):

            def translate_top(load_factor, begin=begin, end=end):
                for constant, a, b in zip(self.translation, begin, end, strict=True):
                    constant.value = (1 - load_factor) * a + load_factor * b

            states.append(self.problem.step(states[-1], translate_top))
        return states[1:]
