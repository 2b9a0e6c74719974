"""Memory of each of several processes: its share of a body's, but for what all of them hold."""

import ctypes
import gc
import tracemalloc

from mpi4py import MPI

import numpy as np
import pytest
from dolfinx.mesh import CellType, create_box

from pw_elements import Iterative
from pw_elements.contact import ContactPair, Motion, Sphere
from tests.contact.cases import PW, ElasticBody, on_plane
from tests.parallel import run_on

SPARE = 1.25


class Heap(ctypes.Structure):
    """What glibc tells of the heap; `mapped` and `used` are bytes in use."""

    _fields_ = [
        (name, ctypes.c_size_t)
        for name in (
            "arena",
            "free",
            "fast",
            "maps",
            "mapped",
            "most",
            "kept",
            "used",
            "left",
            "top",
        )
    ]


def in_use():
    """Bytes of this process, those of PETSc and DOLFINx among them."""
    gc.collect()
    tell = ctypes.CDLL(None).mallinfo2
    tell.restype = Heap
    heap = tell()
    return heap.mapped + heap.used


class Watch:
    """Bytes of Python and NumPy at the height of each stage, over those before it."""

    def __init__(self):
        self.bytes = {}

    def __call__(self, stage, work, *args, **kwargs):
        gc.collect()
        tracemalloc.start()
        made = work(*args, **kwargs)
        self.bytes[stage] = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return made


def pressed(comm, n, path):
    """Bytes at the height of each stage of a block of 2 n x n x n under a ball; and what stays."""
    mesh = create_box(comm, [(0, 0, 0), (2, 1, 1)], (2 * n, n, n), CellType.tetrahedron)
    watch, before = Watch(), in_use()
    body = watch("body", ElasticBody, mesh, PW, "solid")
    near = lambda x: on_plane(2, 1.0)(x) & (np.hypot(x[0] - 1, x[1] - 0.5) < 0.3)  # noqa: E731
    pair, down = ContactPair(near, Sphere((1.0, 0.5, 1.5), 0.5), 0.3), Motion((0, 0, -0.02))
    supports = body.clamp(on_plane(2, 0.0))
    problem = watch("problem", body.contact_problem, pair, supports, solver=Iterative())
    state = watch("step", problem.step, problem.undeformed, body.zero_load, motions=down)
    kept = in_use() - before
    watch("save", problem.save, state, path)
    again = watch("load", problem.load, path)
    assert (again.displacement - state.displacement).norm() == 0.0
    index_map = body.space.dofmap.index_map
    return index_map.size_local + index_map.num_ghosts, watch.bytes | {"kept": kept}


def measured(comm, path):
    """Nodes and bytes of a block, and bytes of hardly any."""
    few = path.with_name(f"{comm.rank}.npz")
    pressed(MPI.COMM_SELF, 2, few)  # imports and compiles
    return *pressed(comm, 8, path), pressed(MPI.COMM_SELF, 2, few)[1]


@pytest.mark.random  # for those are what runs at night
def test_a_process_holds_its_share_of_all_but_contact_surfaces(request, tmp_path):
    """With its ghosts. One process has a whole state, while that is stored or read."""
    if not request.config.getoption("--nightly"):
        pytest.skip("takes 15 processes, with --nightly")
    ((nodes, whole, _),) = run_on(1, measured, tmp_path / "state.npz")
    for count in (2, 4, 8):
        for rank, (own, found, none) in enumerate(run_on(count, measured, tmp_path / "state.npz")):
            for stage, size in found.items():
                if rank > 0 or stage not in ("save", "load"):
                    share = (size - none[stage]) / (whole[stage] - none[stage])
                    assert share < SPARE * own / nodes, f"{stage}, process {rank} of {count}"
