"""Makes gasket.msh, the mesh of gasket.py: half of a flanged joint, radius and height in mm."""

import gmsh

STEEL, FIBRE, MIDDLE, SEAL, FACE, BOLTS, WET, END = range(1, 9)
bore, pipe, rim, hub, top = 50.0, 58.0, 110.0, 24.0, 120.0
seal, thickness, bolts = (56.0, 76.0), 1.5, (88.0, 102.0)

gmsh.initialize(interruptible=False)
gmsh.option.setNumber("General.Terminal", 0)
occ = gmsh.model.occ
corners = [(bore, thickness), (seal[0], thickness), (seal[1], thickness), (rim, thickness),
           (rim, hub), (bolts[1], hub), (bolts[0], hub), (pipe + 8, hub), (pipe, hub + 30),
           (pipe, top), (bore, top)]
points = [occ.addPoint(r, z, 0) for r, z in corners]
lines = [occ.addLine(a, b) for a, b in zip(points, [*points[1:], points[0]], strict=True)]
flange = occ.addPlaneSurface([occ.addCurveLoop(lines)])
gasket = [occ.addPoint(r, z, 0) for r, z in
          [(seal[0], 0), (seal[1], 0), (seal[1], thickness), (seal[0], thickness)]]
sides = [occ.addLine(a, b) for a, b in zip(gasket, [*gasket[1:], gasket[0]], strict=True)]
ring = occ.addPlaneSurface([occ.addCurveLoop(sides)])
occ.synchronize()
gmsh.model.mesh.setSize(gmsh.model.getEntities(0), 5.0)
gmsh.model.mesh.setSize([(0, tag) for tag in points[1:3]], 1.2)
gmsh.model.mesh.setSize([(0, tag) for tag in gasket], 0.75)
for dim, entities, number in [
    (2, [flange], STEEL), (2, [ring], FIBRE), (1, [sides[0]], MIDDLE), (1, [sides[2]], SEAL),
    (1, [lines[1]], FACE), (1, [lines[5]], BOLTS), (1, [lines[0], lines[10], sides[3]], WET),
    (1, [lines[9]], END),
]:
    gmsh.model.addPhysicalGroup(dim, entities, number)
gmsh.model.mesh.generate(2)
gmsh.write("gasket.msh")
gmsh.finalize()
