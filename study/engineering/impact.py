"""Explicit impact with friction at nodes: a block thrown askew on a rough rigid dome.

The block is 2 x 1 (in space 2 x 1 x 1, one half of it), with the density and the speed of sound one
(in uniaxial strain). The standard element has the lumped mass of Hinton, Rock and Zienkiewicz, the
sibling its row sums; both are integrated by the library, each with .9 of its own critical step.
Nodal forces alone enter the law: nothing is read.
"""

from typing import NamedTuple

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from pw_elements import Reduction, prescribe
from pw_elements.contact import ContactPair, Parabola, solve_impact
from pw_elements.meshes import triangles
from study.benchmarks.v12_impact.schemes import Scheme
from study.meshes.solid_meshes import box

Array = npt.NDArray[np.float64]

SCHEMES = {"galerkin": "hrz", "sibling": "sibling"}
DOME, FRICTION = 10.0, 0.3  # radius; mu
SPEED, ASIDE = 0.01, 0.2  # downwards; along x, over that
END = 8.0  # the block has left the dome before


class Thrown(NamedTuple):
    """What becomes of the block.

    Args:
        rebound: mean speed upwards at the end, over that downwards at the start.
        slip: impulse of friction over mu times that of pressing.
        energy: work of friction over the energy at the start.
        imbalance: of energies and work, relative.
        steps: of time.
        time, force: (s,), and (s, dim), total force of the dome.
        dofs: unknowns.
    """

    rebound: float
    slip: float
    energy: float
    imbalance: float
    steps: int
    time: Array
    force: Array
    dofs: int


def thrown(element: str, cells: int) -> Thrown:
    """The impact of the block with so many cells along its height."""
    kind, cell = element.split("-")
    if cell == "T6":
        mesh = triangles(MPI.COMM_SELF, (-1, 0), (1, 1), (2 * cells, cells))
    else:
        ends = ((-1.0, 1.0, 2 * cells), (0.0, 0.5, cells // 2), (0.0, 1.0, cells))
        along, across, up = (np.linspace(a, b, n + 1, dtype=np.float64) for a, b, n in ends)
        mesh = box("tetrahedron", along, across, up)
    found, dim = Scheme.from_name(SCHEMES[kind], mesh), mesh.geometry.dim
    middle = [prescribe(found.space, 1, lambda x: np.isclose(x[1], 0.0))] if dim == 3 else []
    if found.sibling is None:
        held = Reduction.dirichlet(found.space, middle)
    else:
        held = found.sibling.dirichlet(middle)
    velocity = found.K.createVecRight()
    start = SPEED * np.array([ASIDE, *[0.0] * (dim - 2), -1.0])
    velocity.setArray(np.tile(start, velocity.getLocalSize() // dim))
    dome = Parabola((0.0,) * dim, -DOME)
    pair = ContactPair(lambda x: np.isclose(x[dim - 1], 0.0), dome, FRICTION)
    history = solve_impact(found.K, found.M, held, pair, found.space, END, velocity)
    mass = found.M.getDiagonal().array_r.reshape(-1, dim)
    after = (mass * history.velocity.array_r.reshape(-1, dim)).sum(axis=0) / mass.sum(axis=0)
    energies, force = history.energies, history.pairs[0].total
    pressing, rubbing = (history.step * np.sum(force[:, axis]) for axis in (-1, 0))
    return Thrown(
        float(after[-1] / SPEED),
        float(-rubbing / (FRICTION * pressing)),
        float(-energies.friction_work[-1] / energies.total[0]),
        energies.imbalance,
        len(force),
        history.time[:-1],
        force,
        found.K.getSize()[0],
    )
