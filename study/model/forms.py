"""Compiles the forms that many cases share, before the cases, so that none waits for another's.

DOLFINx compiles a form where it is first assembled; who wants it meanwhile looks every second
whether it is there. Elements, states and loads here are those of several sections. What is
missing is compiled with its case, as ever.
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
from study.model.discretisation import is_quadrilateral, spaces

ELEMENTS = ("pw-T6", "galerkin-T6", "composite-T6", "pw-Q9", "galerkin-Q8")
STATES = ("plane stress", "axisymmetric", "plane strain")
SHARED = [(element, state) for state in STATES for element in ELEMENTS]

_FEW = 50  # compiled forms; with more of them in the cache, the shared ones are among them


def shared() -> list[tuple[str, str]]:
    """Return elements and states to compile the forms of; none if the cache is not empty."""
    folder = Path(get_options()["cache_dir"])
    compiled = sum(1 for _ in folder.glob("*.c.cached"))
    return SHARED if compiled < _FEW else []


def compile_shared(element: str, state: str) -> None:
    """Compile stiffness, mass and loads of an element in a state."""
    body = Body(spaces(element, _mesh(element)), Material(1.0, 0.3), StressState(state))
    v, n = ufl.TestFunction(body.spaces.test), ufl.FacetNormal(body.spaces.mesh)
    face = boundary_measure(body.spaces.mesh, lambda x: x[0] > -1.0)
    for form in (body.stiffness(), body.surface_load((0.0, 1.0), face), ufl.inner(n, v) * ufl.ds):
        fem.form(form)
    if body.state is not StressState.PLANE_STRAIN:
        fem.form(body.mass())


def _mesh(element: str) -> Mesh:
    if is_quadrilateral(element):
        return quadrilaterals(MPI.COMM_SELF, (0.0, 0.0), (1.0, 1.0), (1, 1))
    return triangles(MPI.COMM_SELF, (0.0, 0.0), (1.0, 1.0), (1, 1))
