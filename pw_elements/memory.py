"""Memory: what a solver's factors take, and what the machines have left."""

import os
from pathlib import Path

from mpi4py import MPI

# Bytes of MUMPS' LU factors and work space in space: coefficient and power of the unknowns,
# fitted to what MUMPS says of blocks of tetrahedra and hexahedra with 8 000 to 92 000 unknowns
_BYTES, _POWER = 160.0, 1.42


def of_factors(dofs: int) -> float:
    """Bytes that LU factors in space take, by a fit: within a factor of two."""
    return float(_BYTES * dofs**_POWER)


def free(comm: MPI.Comm) -> float:
    """Bytes that the machines of all processes have left, the same on all of them."""
    machine = comm.Split_type(MPI.COMM_TYPE_SHARED)
    # one process of each machine speaks for it; limits of single processes' groups count there
    own = machine.allreduce(_free_here(), MPI.MIN)
    total = comm.allreduce(own if machine.rank == 0 else 0.0, MPI.SUM)
    machine.Free()
    return float(total)


def _free_here() -> float:
    """Bytes left on this machine, to a container or job of a limited memory."""
    try:
        told = dict(line.split(":") for line in Path("/proc/meminfo").read_text().splitlines())
        left = 1024.0 * int(told["MemAvailable"].split()[0])
    except (OSError, KeyError, ValueError):  # no Linux
        left = float(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))
    try:
        group = Path("/proc/self/cgroup").read_text().rpartition("0::/")[2].strip()
        limits = Path("/sys/fs/cgroup") / group
        most, taken = ((limits / f"memory.{name}").read_text() for name in ("max", "current"))
        return min(left, float(most) - float(taken))
    except (OSError, ValueError):  # none, or "max"
        return left
