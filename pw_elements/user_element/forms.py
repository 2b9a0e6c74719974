"""UFL forms of a user element, with constants in place of the data that the host program passes.

The forms are those of `Body`, and for large strains those of the guide's page on large strains.
"""

from collections.abc import Mapping
from dataclasses import dataclass

from mpi4py import MPI

import basix
import basix.ufl
import numpy as np
import ufl
from dolfinx import fem
from dolfinx.mesh import Mesh, create_mesh
from ufl.core.expr import Expr

from pw_elements.arrays import Array
from pw_elements.elasticity import Body, Material, StressState, boundary_measure
from pw_elements.spaces import Spaces

# Degree of quadrature of large strains, whose integrands are not polynomials
LARGE_STRAIN_QUADRATURE_DEGREE = 4


@dataclass(frozen=True)
class ElementForms:
    """Forms and expressions of one element.

    Args:
        forms: forms by the name of their kernel. Each has one integral.
        expressions: expressions and the reference points (n, dim) at which they are evaluated, by
            the name of their kernel.
        displacement: displacement on which the forms may depend.
        sources: C expression of each value of each constant.
    """

    forms: Mapping[str, ufl.Form]
    expressions: Mapping[str, tuple[Expr, Array]]
    displacement: fem.Function
    sources: Mapping[fem.Constant, tuple[str, ...]]


def create_element_forms(
    cell: str, state: StressState, large_strains: bool, geometry_degree: int
) -> ElementForms:
    """Create the forms of an element.

    Args:
        cell: "triangle" or "tetrahedron".
        state: state of stress.
        large_strains: whether the material is neo-Hookean; otherwise it is linear elastic.
        geometry_degree: 1 for cells with straight sides, 2 for cells with curved sides.
    """
    mesh = _create_reference_cell_mesh(cell, geometry_degree)
    dim = mesh.geometry.dim
    properties = [fem.Constant(mesh, value) for value in (1.0, 0.25, 1.0, 1.0)]
    youngs_modulus, poissons_ratio, density, thickness = properties
    load = fem.Constant(mesh, np.zeros(dim))
    pressure = fem.Constant(mesh, 0.0)
    material = Material(youngs_modulus, poissons_ratio, density)
    body = Body(Spaces.petrov_galerkin(mesh), material, state, thickness)
    u = fem.Function(body.spaces.trial)
    surface = boundary_measure(mesh, np.ones(dim + 1, dtype=bool))
    nodes = basix.create_element(
        basix.ElementFamily.P, basix.CellType[cell], 2, basix.LagrangeVariant.gll_warped
    ).points
    forms = {
        "mass": body.mass(),
        "pressure": body.surface_load(-pressure * ufl.FacetNormal(mesh), surface),
        "traction": body.surface_load(load, surface),
        "body_force": body.body_load(load),
    }
    expressions = {"jacobian_determinant": (ufl.JacobianDeterminant(mesh), nodes)}
    if large_strains:
        stress, volume_ratio = _add_neo_hookean_forms(forms, body, u)
        expressions["volume_ratio"] = (volume_ratio, nodes)
    else:
        forms["stiffness"] = body.stiffness()
        forms["internal_force"] = ufl.action(body.stiffness(), u)
        forms["initial_stress"] = body.geometric_stiffness(body.stress(u))
        stress = _list_stresses(body, u)
    expressions["stress"] = (stress, stress_points(cell))
    sources = {value: (f"properties[{k}]",) for k, value in enumerate(properties)}
    sources |= {load: tuple(f"load[{i}]" for i in range(dim)), pressure: ("load[0]",)}
    return ElementForms(forms, expressions, u, sources)


def stress_points(cell: str) -> Array:
    """Return the reference points (4, dim) at which stresses are evaluated.

    They are the points of the quadrature rule of the stiffness of a straight cell: the centres of
    the four sub-cells of a triangle, and the vertices of a tetrahedron.
    """
    if cell == "tetrahedron":
        return basix.geometry(basix.CellType.tetrahedron)
    return np.array([[1, 1], [4, 1], [1, 4], [2, 2]]) / 6


def _create_reference_cell_mesh(cell: str, degree: int) -> Mesh:
    """Return a mesh of the reference cell; triangles are moved away from the axis x = 0."""
    kind = basix.CellType[cell]
    variant = basix.LagrangeVariant.gll_warped
    x = basix.create_element(basix.ElementFamily.P, kind, degree, variant).points
    x = x + 1.0
    element = basix.ufl.element("Lagrange", cell, degree, shape=(x.shape[1],))
    return create_mesh(MPI.COMM_SELF, cells=np.arange(len(x))[None], x=x, e=element)


def _list_stresses(body: Body, u: fem.Function) -> Expr:
    """Return the vector of stresses in Abaqus' order: 11, 22, 33, 12 and in space 13, 23."""
    stress = body.stress(u)
    if body.state is StressState.SOLID:
        pairs = (0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)
        return ufl.as_vector([stress[i, j] for i, j in pairs])
    if body.state is StressState.AXISYMMETRIC:
        out_of_plane = stress[2, 2]
    elif body.state is StressState.PLANE_STRAIN:
        out_of_plane = body.material.poissons_ratio * (stress[0, 0] + stress[1, 1])
    else:
        out_of_plane = ufl.zero()
    return ufl.as_vector([stress[0, 0], stress[1, 1], out_of_plane, stress[0, 1]])


def _add_neo_hookean_forms(
    forms: dict[str, ufl.Form], body: Body, u: fem.Function
) -> tuple[Expr, Expr]:
    """Add the internal force and its derivative; return the true stresses and the volume ratio.

    The first Piola-Kirchhoff stress in plane strain is P = mu (F - F^-T) + lambda ln(J) F^-T, with
    the deformation gradient F, its determinant J, the shear modulus mu and Lamé's constant lambda.
    """
    E, nu = body.material.youngs_modulus, body.material.poissons_ratio
    mu, lame = E / (2 * (1 + nu)), E * nu / ((1 + nu) * (1 - 2 * nu))
    F = ufl.Identity(2) + ufl.grad(u)
    J, F_T = ufl.det(F), ufl.inv(F).T
    P = mu * (F - F_T) + lame * ufl.ln(J) * F_T
    v, direction = ufl.TestFunction(body.spaces.test), ufl.TrialFunction(body.spaces.trial)
    dx = ufl.dx(metadata={"quadrature_degree": LARGE_STRAIN_QUADRATURE_DEGREE})
    forms["internal_force"] = body.thickness * ufl.inner(P, ufl.grad(v)) * dx
    forms["stiffness"] = ufl.derivative(forms["internal_force"], u, direction)
    stress = P * F.T / J
    out_of_plane = lame * ufl.ln(J) / J
    return ufl.as_vector([stress[0, 0], stress[1, 1], out_of_plane, stress[0, 1]]), J
