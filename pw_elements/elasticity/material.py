"""Isotropic elastic materials, constant or varying in space."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TypeAlias

from dolfinx.mesh import Mesh, MeshTags
from ufl.core.expr import Expr

from pw_elements.checks import (
    arguments,
    check_same_arguments_on_all_processes,
    defer_errors_if_parallel,
)
from pw_elements.spaces import piecewise_constants_by_tag

ScalarCoefficient: TypeAlias = float | Expr


@dataclass(frozen=True)
class Material:
    """Isotropic elastic material, whose constants are numbers or vary in space.

        steel = Material(210e3, 0.3, 7.85e-9)  # N, mm, t, s

    Constants that vary in space are UFL expressions. `by_tag` combines several materials on one
    mesh. Numbers, `fem.Constant`s and nodal values of Lagrange functions are checked; the values of
    other expressions cannot be checked.

    Args:
        youngs_modulus: Young's modulus, a positive stress.
        poissons_ratio: Poisson's ratio, greater than -1 and at most 1/2. The value 1/2 is allowed
            only in plane stress and in hybrid spaces.
        density: mass per volume, positive.

    Raises:
        ValueError: for a modulus or density that is not positive, or for a Poisson's ratio outside
            (-1, 1/2].
    """

    youngs_modulus: ScalarCoefficient
    poissons_ratio: ScalarCoefficient = 0.0
    density: ScalarCoefficient = 1.0

    @defer_errors_if_parallel
    def __post_init__(self) -> None:
        for name in ("youngs_modulus", "density"):
            value = arguments.check_positive_coefficient(name, getattr(self, name))
            object.__setattr__(self, name, value)
        nu = arguments.check_coefficient(
            "poissons_ratio",
            self.poissons_ratio,
            lambda values: (values > -1) & (values <= 0.5),
            "has to lie between -1 and 0.5",
        )
        object.__setattr__(self, "poissons_ratio", nu)

    @classmethod
    @check_same_arguments_on_all_processes
    def by_tag(
        cls, mesh: Mesh, cell_tags: MeshTags, materials: Mapping[int, "Material"]
    ) -> "Material":
        """Create a material that in each cell equals the material given for the cell's tag.

            material = Material.by_tag(mesh, cell_tags, {1: Material(210e3, 0.3), 2: rubber})

        Args:
            mesh: mesh of the body.
            cell_tags: tags of all cells of the mesh.
            materials: material of each tag; its constants have to be numbers.

        Raises:
            TypeError: for arguments of the wrong type.
            ValueError: if the tags belong to facets or to another mesh, a cell has no tag, a tag
                has no material, no cell has the tag of a material, or a constant is not a number.
        """
        arguments.check_double_precision_mesh(mesh)
        arguments.check_type(
            "the mapping of tags", materials, Mapping, "give {tag: Material(E, nu), ...}"
        )
        constants = {}
        for tag, material in materials.items():
            label = f"the material of tag {tag}"
            arguments.check_type(label, material, Material, "Material(E, nu) makes one")
            constants[tag] = [
                arguments.check_finite_number(f"{name} of {label}", value)
                for name, value in vars(material).items()
            ]
        return cls(*piecewise_constants_by_tag(mesh, cell_tags, constants))
