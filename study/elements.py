"""The elements that the study compares, by the names of its result files."""

from dolfinx.mesh import Mesh

from pw_elements import Spaces

# CPS6, CPS8 (plane stress) of the paper's commercial code are the standard Galerkin elements
_SPACES = {
    "galerkin-T6": Spaces.galerkin,
    "pw-T6": Spaces.petrov_galerkin,
    "pwsym-T6": Spaces.petrov_galerkin,
    "galerkin-Q8": Spaces.serendipity,
}


def spaces(element: str, mesh: Mesh) -> Spaces:
    """Displacement spaces of an element on a mesh of its cells."""
    return _SPACES[element](mesh)


def is_quadrilateral(element: str) -> bool:
    """Whether the element's mesh is one of quadrilaterals."""
    return element.rpartition("-")[2].startswith("Q")


def is_symmetrised(element: str) -> bool:
    """Whether matrices are replaced by their symmetric parts, as a symmetric solver does."""
    return element.startswith("pwsym")
