import gmsh

STEEL, FIBRE, BASE, TOP = 1, 2, 3, 4

gmsh.initialize(interruptible=False)
gmsh.option.setNumber("General.Terminal", 0)
occ = gmsh.model.occ
steel, fibre = occ.addRectangle(-20, 0, 0, 40, 2), occ.addRectangle(-20, 2, 0, 40, 4)
occ.fragment([(2, steel)], [(2, fibre)])
occ.synchronize()
for tag, layer in ((STEEL, steel), (FIBRE, fibre)):
    gmsh.model.addPhysicalGroup(2, [layer], tag)
for tag, y in ((BASE, 0), (TOP, 6)):
    lines = gmsh.model.getEntitiesInBoundingBox(-21, y - 0.1, -1, 21, y + 0.1, 1, 1)
    gmsh.model.addPhysicalGroup(1, [line for _, line in lines], tag)
gmsh.option.setNumber("Mesh.MeshSizeMax", 0.5)
gmsh.model.mesh.generate(2)
gmsh.model.mesh.setOrder(2)
gmsh.write("gasket.msh")
gmsh.finalize()
