"""Words of refused contact problems on any number of processes, as JSON.

mpirun -n 2 python3 -m mpi4py -m tests.contact.refused_words
"""

import json

from mpi4py import MPI

from dolfinx.mesh import CellType, create_box

from pw_elements import (
    Body,
    Material,
    Reduction,
    Spaces,
    assemble_matrix,
    assemble_vector,
    prescribe,
)
from pw_elements.contact import ContactFailed, ContactPair, Motion, Plane
from pw_elements.contact import solve_contact as solve
from pw_elements.contact.model import MatchingNodes
from pw_elements.elasticity import StressState
from pw_elements.meshes import triangles
from tests.contact.cases import at
from tests.contact.test_matching import doubled, lower_nodes

WORLD = MPI.COMM_WORLD


def words(mesh, pairs, force, state=StressState.PLANE_STRAIN, conditions=()):
    """The message of a refusal, which is the same on all processes."""
    body = Body(Spaces.petrov_galerkin(mesh), Material(1000.0, 0.3), state)
    space = body.spaces.trial
    supports = Reduction.dirichlet(space, [prescribe(space, *c) for c in conditions])
    load = assemble_vector(body.body_load(force))
    try:
        solve(assemble_matrix(body.stiffness()), load, supports, pairs(space), space)
    except ContactFailed as error:
        said = f"{type(error).__name__}: {error}"
        assert len(set(WORLD.allgather(said))) == 1
        return said
    return "solved"


def rough(mu, normal=(0, 1), **options):
    """A floor."""
    axis = len(normal) - 1
    plane = Plane((0,) * len(normal), normal)
    return lambda _: [ContactPair(at(axis, 0.0), plane, mu, **options)]


def stacked(space):
    """A block on a block on a floor."""
    lower, upper = (lower_nodes(space, 1.0, above) for above in (False, True))
    between = ContactPair(upper, MatchingNodes(lower, Plane((0, 1), (0, 1))), 0.3)
    return [ContactPair(at(1, 0.0), Plane((0, 0), (0, 1)), 0.6), between]


def plate(_):
    """A plate that is pulled off the top."""
    motions = [Motion((None, None), (0, 1.0))]
    return [ContactPair(at(1, 1.0), Plane((0, 1), (0, -1)), 0.3, motions)]


def main():
    """Prints the words."""
    flat = triangles(WORLD, (0.0, 0.0), (2.0, 1.0), (6, 3))
    single = triangles(MPI.COMM_SELF, (0.0, 0.0), (2.0, 1.0), (6, 3))
    apart, above = (doubled(single, shift, WORLD) for shift in ((5.0, 0, 0), (0, 1.0, 0)))
    solid = create_box(WORLD, [(0, 0, 0), (2, 2, 1)], [2, 2, 2], CellType.tetrahedron)
    clamped = [(0, at(1, 0.0)), (1, at(1, 0.0))]
    results = [
        words(flat, rough(0.3), (0.4, -1.0)),
        words(flat, rough(0.3), (0.0, 1.0)),
        words(flat, rough(3.0), (2.5, -1.0)),
        words(flat, plate, (0.0, 0.0), conditions=clamped),
        words(apart, rough(0.0), (0.0, -1.0)),
        words(apart, rough(0.3), (0.4, -1.0)),
        words(above, stacked, (0.4, -1.0)),
        words(solid, rough(0.0, (0, 0, 1)), (0.0, 0.0, -1.0), StressState.SOLID),
        words(solid, rough(0.3, (0, 0, 1)), (0.3, 0.3, -1.0), StressState.SOLID),
        words(flat, rough(0.0), (0.3, 1.0), StressState.AXISYMMETRIC),
    ]
    if WORLD.rank == 0:
        print(json.dumps(results))


if __name__ == "__main__":
    main()
