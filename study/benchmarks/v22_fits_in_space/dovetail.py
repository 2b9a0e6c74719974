"""Half a dovetail that is pulled, then slid along its slot, in space."""

import tempfile
from pathlib import Path

from mpi4py import MPI

import gmsh
import numpy as np

from pw_elements.arrays import Array, Indices
from pw_elements.contact import SLIP
from pw_elements.meshes import TaggedMesh, from_file
from study.benchmarks.v17_bodies.problems import make_dimensionless_result, solve_sliding_of_bodies
from study.run.store import Result
from study.solutions.rubber import NeoHookeanBody

QUADRATURE_DEGREE = 4
PULL, SLIDE, FRICTION = 0.02, 0.3, 0.2
"""Displacements of the blade's top, over the half width of its root; coefficient of friction."""
N_SLIDING = 6
TIMES = (0.5, 1.0, *(1 + (k + 1) / N_SLIDING for k in range(N_SLIDING)))
COARSE_OVER_FINE = 2.5
"""Size of cells away from the flanks over that at the flanks."""
FACES = ("BLADE_FLANK", "SLOT_FLANK", "BLADE_TOP", "SLOT_BASE")
FLANK_NORMAL = np.array([1.0, 0.0, 1.0]) / np.sqrt(2)
FLANK_DIRECTION = np.array([-1.0, 0.0, 1.0]) / np.sqrt(2)
MAX_DISTANCE_FROM_MIDDLE = 0.7
"""Part of the flank on which pressures are compared with a smooth fit: distance from its middle,
over the half length along both sides.
"""


def write_dovetail(path: Path, sizes: tuple[float, float]) -> None:
    """Write an assembly of half a blade's dovetail root in its slot as an Abaqus file, by Gmsh.

    The symmetry plane is x = 0, and the dovetail can slide along y. The flanks that touch are
    inclined by 45°. Parts and faces are sets: BLADE, SLOT, BLADE_FLANK, SLOT_FLANK, BLADE_TOP and
    SLOT_BASE.

    Args:
        path: Path of the file.
        sizes: Cell sizes at the flanks of blade and slot; cells are larger elsewhere.
    """
    # outlines in the plane (x, z)
    blade = [(0, 0), (1.0, 0), (1.0, 0.4), (0.5, 0.9), (0.5, 1.6), (0, 1.6)]
    slot = [(1.15, -0.1), (2.0, -0.1), (2.0, 1.2), (0.55, 1.2), (0.55, 0.85), (1.15, 0.25)]
    depths = (0.0, 0.8), (-0.2, 1.4)  # along y
    gmsh.initialize(readConfigFiles=False, interruptible=False)
    try:
        for option, value in {
            "General.Terminal": 0,
            "General.NumThreads": 1,
            "Mesh.Algorithm": 5,
            "Mesh.Algorithm3D": 1,
            "Mesh.SaveGroupsOfNodes": 0,
        }.items():
            gmsh.option.setNumber(option, value)
        occ = gmsh.model.occ
        solids = []
        for outline, (start, end) in zip((blade, slot), depths, strict=True):
            points = [occ.addPoint(px, start, pz) for px, pz in outline]
            ends = zip(points, [*points[1:], points[0]], strict=True)
            lines = [occ.addLine(*pair) for pair in ends]
            face = occ.addPlaneSurface([occ.addCurveLoop(lines)])
            solids += [tag for dim, tag in occ.extrude([(2, face)], 0, end - start, 0) if dim == 3]
        occ.synchronize()
        for name, solid, size in zip(("BLADE", "SLOT"), solids, sizes, strict=True):
            gmsh.model.addPhysicalGroup(3, [solid], name=name)
            points = gmsh.model.getBoundary([(3, solid)], recursive=True)
            gmsh.model.mesh.setSize(points, COARSE_OVER_FINE * size)

        def find_face(solid: int, middle: tuple[float, float]) -> list[int]:
            return [
                tag
                for dim, tag in gmsh.model.getBoundary([(3, solid)], oriented=False)
                if np.allclose(np.array(occ.getCenterOfMass(dim, tag))[[0, 2]], middle, atol=1e-6)
            ]

        for name, solid, middle in zip(
            FACES,
            (solids[0], solids[1], solids[0], solids[1]),
            ((0.75, 0.65), (0.85, 0.55), (0.25, 1.6), (2.0, 0.55)),
            strict=True,
        ):
            faces = find_face(solid, middle)
            gmsh.model.addPhysicalGroup(2, faces, name=name)
            if name.endswith("FLANK"):
                points = gmsh.model.getBoundary([(2, face) for face in faces], recursive=True)
                gmsh.model.mesh.setSize(points, sizes[solids.index(solid)])
        gmsh.model.mesh.generate(3)
        gmsh.model.mesh.setOrder(2)
        gmsh.write(str(path))
    finally:
        gmsh.finalize()


def read_dovetail(path: Path) -> tuple[TaggedMesh, tuple[Indices, Indices]]:
    """Read the assembly; return it, and the facets of the blade's flank and of the slot's."""
    part = from_file(path, MPI.COMM_SELF)
    blade, slot = (part.facets(name).astype(np.int64) for name in FACES[:2])
    return part, (blade, slot)


def slide_dovetail(element: str, size: float) -> Result:
    """Read half a dovetail from an Abaqus file, pull it, then slide it along its slot.

    Args:
        element: Name of the element.
        size: Size of the cells at the blade's flank; those of the slot are a quarter larger.
    """
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "dovetail.inp"
        write_dovetail(path, (size, 1.25 * size))
        part, sides = read_dovetail(path)
    bodies = NeoHookeanBody(element, part.mesh, QUADRATURE_DEGREE)
    x = bodies.x
    is_top, is_base = (np.isclose(x[:, axis], end) for axis, end in ((2, 1.6), (0, 2.0)))

    def set_displacements(time: float, displacement: Array) -> None:
        displacement[is_top] = [0.0, SLIDE * max(0.0, time - 1), PULL * min(time, 1.0)]

    record = solve_sliding_of_bodies(
        bodies,
        [sides],
        set_displacements,
        (is_top, is_base),
        TIMES,
        [(0, lambda x: np.isclose(x[0], 0.0))],
        FRICTION,
    )
    pairs = [state.pairs[0] for state in record.states]
    last = pairs[-1]
    force = np.array([pair.force for pair in pairs])
    bodies.solution.x.array[:] = record.states[1].displacement.array_r
    weight = bodies.integrate_weights_over_deformed_sides(sides)
    scalars = record.summarise_iterations() | {
        "N": -float(last.force @ FLANK_NORMAL),
        "T": float(np.abs(last.force[1])),
        "friction_error": abs(abs(last.force[1]) / last.force_normal.sum() / FRICTION - 1),
        "slipping": float(np.mean(last.status == SLIP)),
        "balance_error": record.largest_force_imbalance(),
        "cone_error": record.largest_friction_law_violation(),
    }
    curves = {"path_force": force}
    middle, half = _find_middle_and_half_lengths(x[pairs[1].node])
    for suffix, node, nodal in (
        ("", pairs[1].node, pairs[1].force_normal),
        ("_master", pairs[1].opposite_node, np.asarray(pairs[1].opposite_force @ FLANK_NORMAL)),
    ):
        s = (_project_on_flank(x[node]) - middle) / half
        has_weight = weight[node] > 0
        is_compared = has_weight & np.all(np.abs(s) < MAX_DISTANCE_FROM_MIDDLE, axis=1)
        pressure = nodal[is_compared] / weight[node][is_compared]
        scalars |= {
            f"pressure_scatter{suffix}": _measure_scatter(s[is_compared], pressure),
            f"weightless_nodes{suffix}": float(
                np.mean(~has_weight[np.all(np.abs(s) < MAX_DISTANCE_FROM_MIDDLE, axis=1)])
            ),
        }
        curves |= {f"s{suffix}": s, f"force{suffix}": nodal, f"weight{suffix}": weight[node]}
    return make_dimensionless_result(scalars, curves, len(bodies.solution.x.array))


def _project_on_flank(x: Array) -> Array:
    """Return coordinates (n, 2) of points (n, 3) along y and up the flank."""
    return np.column_stack([x[:, 1], x @ FLANK_DIRECTION])


def _find_middle_and_half_lengths(x: Array) -> tuple[Array, Array]:
    s = _project_on_flank(x)
    low, high = s.min(axis=0), s.max(axis=0)
    return (low + high) / 2, (high - low) / 2


def _measure_scatter(s: Array, pressure: Array) -> float:
    """Return the root mean square deviation of pressures from a smooth fit, over their mean.

    The fit is a polynomial of degree 2, by least squares.

    Args:
        s: Coordinates (n, 2) of the nodes, between -1 and 1.
        pressure: Pressures (n,).
    """
    a, b = s.T
    terms = np.column_stack([np.ones(len(s)), a, b, a**2, a * b, b**2])
    fit, *_ = np.linalg.lstsq(terms, pressure, rcond=None)
    return float(np.sqrt(np.mean((pressure - terms @ fit) ** 2)) / pressure.mean())
