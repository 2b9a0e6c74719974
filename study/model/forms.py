"""Compile forms that many cases share before the cases run.

DOLFINx compiles a form when it is first assembled; other processes that need the form poll for it
every second. The elements, states of stress and loads of this module are used by several sections.
Other forms are compiled when their cases run.
"""

from pathlib import Path

from mpi4py import MPI

import ufl
from dolfinx import fem
from dolfinx.jit import get_options
from dolfinx.mesh import Mesh

from pw_elements import Body, Material, boundary_measure
from pw_elements.elasticity import StressState
from pw_elements.meshes import quadrilaterals, triangles
from study.model.discretisation import make_element_spaces, requires_quadrilateral_cells

SHARED_ELEMENTS = ("pw-T6", "galerkin-T6", "composite-T6", "pw-Q9", "galerkin-Q8")
SHARED_STATES = ("plane stress", "axisymmetric", "plane strain")
SHARED_ELEMENT_STATES = [(element, state) for state in SHARED_STATES for element in SHARED_ELEMENTS]

# If the cache contains at least this many forms, it is assumed to contain the shared ones
_MIN_FILLED_CACHE_FORMS = 50


def list_forms_to_compile() -> list[tuple[str, str]]:
    """Return the pairs (element, state of stress) whose forms must be compiled.

    The list is empty if the cache already contains many forms.
    """
    folder = Path(get_options()["cache_dir"])
    compiled = sum(1 for _ in folder.glob("*.c.cached"))
    return SHARED_ELEMENT_STATES if compiled < _MIN_FILLED_CACHE_FORMS else []


def compile_element_forms(element: str, state: str) -> None:
    """Compile the stiffness, mass and load forms of an element in a state of stress."""
    body = Body(
        make_element_spaces(element, _mesh_unit_square_coarsely(element)),
        Material(1.0, 0.3),
        StressState(state),
    )
    v, n = ufl.TestFunction(body.spaces.test), ufl.FacetNormal(body.spaces.mesh)
    face = boundary_measure(body.spaces.mesh, lambda x: x[0] > -1.0)
    for form in (body.stiffness(), body.surface_load((0.0, 1.0), face), ufl.inner(n, v) * ufl.ds):
        fem.form(form)
    if body.state is not StressState.PLANE_STRAIN:
        fem.form(body.mass())


def _mesh_unit_square_coarsely(element: str) -> Mesh:
    if requires_quadrilateral_cells(element):
        return quadrilaterals(MPI.COMM_SELF, (0.0, 0.0), (1.0, 1.0), (1, 1))
    return triangles(MPI.COMM_SELF, (0.0, 0.0), (1.0, 1.0), (1, 1))
