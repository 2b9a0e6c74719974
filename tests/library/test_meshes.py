"""Rectangles and Gmsh's meshes: bad input is named, and lines are where they were asked for."""

from mpi4py import MPI

import gmsh
import numpy as np
import pytest
import ufl

from pw_elements import assemble_scalar, boundary_measure
from pw_elements.meshes import from_gmsh, on_lines

COMM = MPI.COMM_SELF
LINES = np.array([0.0, 0.1, 0.5, 2.0])


@pytest.mark.parametrize("cell", ["triangle", "quadrilateral"])
def test_lines_are_where_they_were_asked_for(cell):
    x = on_lines(COMM, LINES, LINES - 2.0, cell).geometry.x
    assert np.unique(x[:, 0].round(12)) == pytest.approx(LINES)
    assert np.unique(x[:, 1].round(12)) == pytest.approx(LINES - 2.0)


@pytest.fixture
def square():
    """Gmsh with a model of a unit square, one half of which is group 1."""
    gmsh.initialize(interruptible=False)
    gmsh.option.setNumber("General.Terminal", 0)
    left, right = (gmsh.model.occ.addRectangle(x, 0, 0, 0.5, 1) for x in (0, 0.5))
    gmsh.model.occ.fragment([(2, left)], [(2, right)])
    gmsh.model.occ.synchronize()
    yield gmsh.model
    gmsh.finalize()


@pytest.mark.parametrize("order", [1, 2])
def test_a_mesh_from_gmsh_has_its_groups(square, order):
    square.addPhysicalGroup(2, [1], 4)
    square.addPhysicalGroup(2, [2], 7)
    lower = square.getEntitiesInBoundingBox(-1, -1e-6, -1, 2, 1e-6, 1, 1)
    square.addPhysicalGroup(1, [tag for _, tag in lower], 3)
    square.mesh.generate(2)
    square.mesh.setOrder(order)
    mesh, cells, facets = from_gmsh(MPI.COMM_SELF, square, dim=2)
    assert mesh.geometry.dim == 2
    assert mesh.ufl_domain().ufl_coordinate_element().degree == order
    for number in (4, 7):
        here = ufl.Measure("dx", domain=mesh, subdomain_data=cells, subdomain_id=number)
        assert assemble_scalar(1.0 * here) == pytest.approx(0.5)
    below = boundary_measure(mesh, facets.find(3))
    assert assemble_scalar(1.0 * below) == pytest.approx(1.0)


def test_a_file_gives_the_mesh_it_was_written_from(square, tmp_path):
    square.addPhysicalGroup(2, [1, 2], 1)
    square.mesh.generate(2)
    gmsh.write(str(tmp_path / "square.msh"))
    count = len(square.mesh.getNodes()[0])
    with pytest.raises(ValueError, match="Gmsh is at work"):
        from_gmsh(MPI.COMM_SELF, tmp_path / "square.msh", dim=2)
    gmsh.finalize()
    mesh, _, facets = from_gmsh(MPI.COMM_SELF, tmp_path / "square.msh", dim=2)
    assert mesh.geometry.index_map().size_global == count
    assert len(facets.find(1)) == 0
    assert not gmsh.isInitialized()
    gmsh.initialize(interruptible=False)


def test_what_gmsh_does_not_have_is_said(square, tmp_path):
    with pytest.raises(ValueError, match="has no mesh"):
        from_gmsh(MPI.COMM_SELF, square, dim=2)
    square.mesh.generate(2)
    with pytest.raises(ValueError, match="no physical group has the cells"):
        from_gmsh(MPI.COMM_SELF, square, dim=2)
    with pytest.raises(ValueError, match="dim = 4"):
        from_gmsh(MPI.COMM_SELF, square, dim=4)
    with pytest.raises(FileNotFoundError, match="nowhere"):
        from_gmsh(MPI.COMM_SELF, tmp_path / "nowhere.msh")
    gmsh.finalize()
    (tmp_path / "bad.msh").write_text("no mesh")
    with pytest.raises(ValueError, match="cannot be read"):
        from_gmsh(MPI.COMM_SELF, tmp_path / "bad.msh")
    assert not gmsh.isInitialized()
    gmsh.initialize(interruptible=False)
