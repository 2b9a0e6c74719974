"""Geometry and mesh of gears.py: three involute teeth of each of two gears."""

import gmsh
import numpy as np

teeth, module, slope = 20, 4.0, np.radians(20)
pitch, backlash = teeth * module / 2, 0.002
base, tip, root, rim = pitch * np.cos(slope), pitch + module, pitch - 1.25 * module, 0.68 * pitch
LEFT, RIGHT, RIMS, FLANKS = 1, 2, (3, 4), (5, 6)


def gear(centre, facing, fine):
    """Face, rim and middle flank of a gear whose flank is at the pitch point, `facing` it."""
    r = np.linspace(base, tip, 12)
    phi = np.arccos(base / r)
    half = np.pi / (2 * teeth) + np.tan(slope) - slope - np.tan(phi) + phi  # of the tooth at r
    occ, curves, flank = gmsh.model.occ, [], None

    def point(r, angle, h):
        angle += facing
        return occ.addPoint(centre + r * np.cos(angle), r * np.sin(angle), 0, h)

    last = start = point(rim, -3 * np.pi / teeth - np.pi / 2 / teeth, 3.0)
    for tooth in (-1, 0, 1):
        middle = (2 * tooth - 0.5) * np.pi / teeth
        right = [point(a, middle - h + backlash, 2 * fine) for a, h in zip(r, half, strict=True)]
        left = [point(a, middle + h, fine) for a, h in zip(r, half, strict=True)][::-1]
        foot = point(root, middle - half[0] - 0.02, 1.0), point(root, middle + half[0] + 0.02, 1.0)
        curves += [occ.addLine(last, foot[0]), occ.addLine(foot[0], right[0]),
                   occ.addSpline(right), occ.addLine(right[-1], left[0]), occ.addSpline(left),
                   occ.addLine(left[-1], foot[1])]
        flank = curves[-2] if tooth == 0 else flank
        last = foot[1]
    end = point(rim, 2.5 * np.pi / teeth, 3.0)
    inner = occ.addCircleArc(end, occ.addPoint(centre, 0, 0), start)
    curves += [occ.addLine(last, end), inner]
    return occ.addPlaneSurface([occ.addCurveLoop(curves)]), inner, flank


def mesh_gears(size):
    """Has Gmsh mesh both, with elements of this size on the flanks in contact; lengths in mm."""
    parts = gear(0, 0, size), gear(2 * pitch, np.pi, 1.4 * size)
    gmsh.model.occ.synchronize()
    for (face, inner, flank), number in zip(parts, (LEFT, RIGHT), strict=True):
        gmsh.model.addPhysicalGroup(2, [face], number)
        for entity, group in ((inner, RIMS), (flank, FLANKS)):
            gmsh.model.addPhysicalGroup(1, [entity], group[number - 1])
    gmsh.model.mesh.generate(2)
    gmsh.model.mesh.setOrder(2)
