"""Memory of each process, for its share of the body and for all contact surfaces."""

import ctypes
import gc
import tracemalloc

from mpi4py import MPI

import numpy as np
import pytest
from dolfinx.mesh import CellType, create_box

from pw_elements import Iterative
from pw_elements.contact import ContactPair, Motion, Sphere
from tests.contact.cases import PETROV_GALERKIN, ElasticBody, on_plane
from tests.parallel import run_on_processes

MAX_MEMORY_SHARE_OVER_NODE_SHARE = 1.25


class HeapStatistics(ctypes.Structure):
    """Statistics of glibc's heap; the fields `mapped` and `used` are numbers of bytes in use."""

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


def bytes_in_use():
    """Return the number of heap bytes in use, including those of PETSc and DOLFINx."""
    gc.collect()
    mallinfo = ctypes.CDLL(None).mallinfo2
    mallinfo.restype = HeapStatistics
    heap = mallinfo()
    return heap.mapped + heap.used


class PeakMemoryRecorder:
    """Recorder of the peak bytes that Python and NumPy allocate in each stage of a computation.

    Bytes in use before a stage do not count.
    """

    def __init__(self):
        self.bytes = {}

    def __call__(self, stage, function, *args, **kwargs):
        gc.collect()
        tracemalloc.start()
        result = function(*args, **kwargs)
        self.bytes[stage] = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return result


def measure_nodes_and_memory_of_stages(comm, cells_per_height, state_path):
    """Return the number of nodes on this process, ghosts included, and the bytes of each stage.

    The bytes are peak values; those with the name "kept" are still in use after the increment. The
    problem is a block of 2 n x n x n cells under a ball, where n is `cells_per_height`.
    """
    mesh = create_box(
        comm,
        [(0, 0, 0), (2, 1, 1)],
        (2 * cells_per_height, cells_per_height, cells_per_height),
        CellType.tetrahedron,
    )
    peak, bytes_before = PeakMemoryRecorder(), bytes_in_use()
    body = peak("body", ElasticBody, mesh, PETROV_GALERKIN, "solid")
    near_ball = lambda x: on_plane(2, 1.0)(x) & (np.hypot(x[0] - 1, x[1] - 0.5) < 0.3)  # noqa: E731
    pair, motion = ContactPair(near_ball, Sphere((1.0, 0.5, 1.5), 0.5), 0.3), Motion((0, 0, -0.02))
    supports = body.make_clamping_supports(on_plane(2, 0.0))
    problem = peak("problem", body.contact_problem, pair, supports, solver=Iterative())
    state = peak("step", problem.step, problem.undeformed, body.zero_load, motions=motion)
    bytes_kept = bytes_in_use() - bytes_before
    peak("save", problem.save, state, state_path)
    loaded_state = peak("load", problem.load, state_path)
    assert (loaded_state.displacement - state.displacement).norm() == 0.0
    index_map = body.space.dofmap.index_map
    return index_map.size_local + index_map.num_ghosts, peak.bytes | {"kept": bytes_kept}


def measure_memory_of_large_and_small_block(comm, state_path):
    """Return the number of nodes and the bytes of a block, and the bytes of a very small block.

    The result is that of `measure_nodes_and_memory_of_stages`; the small block runs on one process.
    """
    small_path = state_path.with_name(f"{comm.rank}.npz")
    measure_nodes_and_memory_of_stages(
        MPI.COMM_SELF, 2, small_path
    )  # imports and compiles before any measurement
    return *measure_nodes_and_memory_of_stages(
        comm, 8, state_path
    ), measure_nodes_and_memory_of_stages(MPI.COMM_SELF, 2, small_path)[1]


@pytest.mark.random  # tests of this mark run at night
def test_a_process_holds_its_share_of_all_data_but_contact_surfaces(request, tmp_path):
    """A process holds only its share of all data except those of contact surfaces.

    The memory beyond that of a very small block is compared with the process's share of the nodes,
    ghosts included. Process 0 holds a whole state while it is saved or loaded.
    """
    if not request.config.getoption("--nightly"):
        pytest.skip("takes 15 processes, with --nightly")
    ((nodes, serial_bytes, _),) = run_on_processes(
        1, measure_memory_of_large_and_small_block, tmp_path / "state.npz"
    )
    for count in (2, 4, 8):
        for rank, (own_nodes, bytes_by_stage, small_bytes) in enumerate(
            run_on_processes(count, measure_memory_of_large_and_small_block, tmp_path / "state.npz")
        ):
            for stage, n_bytes in bytes_by_stage.items():
                if rank > 0 or stage not in ("save", "load"):
                    fraction = (n_bytes - small_bytes[stage]) / (
                        serial_bytes[stage] - small_bytes[stage]
                    )
                    assert fraction < MAX_MEMORY_SHARE_OVER_NODE_SHARE * own_nodes / nodes, (
                        f"{stage}, process {rank} of {count}"
                    )
