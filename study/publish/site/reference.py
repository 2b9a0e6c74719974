"""Write the reference of the library: one page per public name, made from its docstring."""

import inspect
from importlib import import_module
from pathlib import Path

from study.publish.site.gallery import GalleryExample, example_heading
from study.publish.site.mathematics import typeset_plain_text_mathematics

# Names in each group of pages; names with a submodule are argument or return types of public ones
NAME_GROUPS: dict[str, tuple[str, tuple[str, ...]]] = {
    "Spaces and elements": (
        "pw_elements",
        (
            "Spaces",
            "test_space",
            "as_function",
            "split",
            "cell_measure",
            "history_space",
        ),
    ),
    "Elastic bodies and loads": (
        "pw_elements",
        (
            "Body",
            "Material",
            "elasticity.StressState",
            "boundary_measure",
            "prescribe",
            "elasticity.nodal_load",
            "lumped_mass",
        ),
    ),
    "Assembly and solution": (
        "pw_elements",
        (
            "assemble_matrix",
            "assemble_vector",
            "assemble_scalar",
            "Reduction",
            "solve",
            "reactions",
            "algebra.symmetric_part",
            "Direct",
            "Iterative",
            "solvers.LinearSolver",
            "solvers.SolverReport",
            "SingularSystem",
            "NotConverged",
        ),
    ),
    "Any residual": ("pw_elements", ("PetrovGalerkinProblem",)),
    "Nodal forces as fluxes": ("pw_elements", ("nodal_flux", "elasticity.NodalFlux")),
    "Vibration, buckling, dynamics": (
        "pw_elements",
        (
            "vibration_modes",
            "algebra.VibrationModes",
            "buckling",
            "algebra.BucklingModes",
            "TooFewModes",
            "Sibling",
            "critical_step",
        ),
    ),
    "Contact: stating it": (
        "pw_elements.contact",
        (
            "ContactPair",
            "Motion",
            "Coulomb",
            "model.Friction",
            "model.Surface",
            "Plane",
            "Sphere",
            "Parabola",
            "FlatPunch",
            "SignedDistance",
            "DeformableSurface",
            "model.MatchingNodes",
        ),
    ),
    "Contact: interface laws": (
        "pw_elements.contact",
        (
            "model.ElasticInterface",
            "model.Tie",
            "model.UnilateralContact",
            "model.CohesiveContact",
            "model.InterfaceLaw",
            "model.InterfaceValues",
            "model.InterfaceResponse",
            "model.SofteningLaw",
        ),
    ),
    "Contact: solving it": (
        "pw_elements.contact",
        ("solve_contact", "ContactProblem", "output.Progress", "solve_impact"),
    ),
    "Contact: results": (
        "pw_elements.contact",
        (
            "model.ContactState",
            "model.PairState",
            "model.Residuals",
            "model.SmallDisplacementMeasures",
            "ContactFields",
            "write",
            "plot",
            "steps.ImpactHistory",
            "steps.PairHistory",
            "steps.Energies",
        ),
    ),
    "Contact: heat": ("pw_elements.conduction", ("interface_conduction", "friction_heat")),
    "Contact: what can go wrong": (
        "pw_elements.contact",
        (
            "ContactFailed",
            "NoEquilibrium",
            "FreeBody",
            "NotUnique",
            "SolutionNotFound",
            "SurfacePassed",
            "model.LoadMissingForEquilibrium",
            "model.RigidVelocity",
        ),
    ),
    "Meshes": (
        "pw_elements.meshes",
        (
            "from_file",
            "from_gmsh",
            "TaggedMesh",
            "triangles",
            "quadrilaterals",
            "move_nodes",
            "curved_mesh",
        ),
    ),
    "Pressures and forces on a surface": (
        "pw_elements",
        ("SurfaceNodes", "forces_along", "elasticity.BoundaryForces", "force_transfer"),
    ),
    "Pictures and checks": ("pw_elements", ("draw", "checks.DegenerateMesh")),
}
CONSTANTS_WITHOUT_PAGE = {
    "HELD",
    "OPEN",
    "STICK",
    "SLIP",
}  # statuses of contact nodes, which the page of PairState explains


def list_names_with_reference_page() -> list[str]:
    """Return the full names of everything with a page in the reference."""
    return [
        f"{module}.{name}"
        for module, names in _groups_with_ungrouped_names_added().values()
        for name in names
    ]


def _groups_with_ungrouped_names_added() -> dict[str, tuple[str, tuple[str, ...]]]:
    """Return `NAME_GROUPS` with an additional group for each module that has further public names.

    Returns:
        Module and names of each group, by title of the group.
    """
    groups = dict(NAME_GROUPS)
    for module in ("pw_elements", "pw_elements.contact", "pw_elements.meshes"):
        grouped_names = {
            name
            for group_module, names in NAME_GROUPS.values()
            if group_module == module
            for name in names
        }
        if other_names := sorted(
            {*import_module(module).__all__} - grouped_names - CONSTANTS_WITHOUT_PAGE
        ):
            groups[f"Others of {module}"] = (module, tuple(other_names))
    return groups


def _move_submodule_from_name_to_module(module: str, name: str) -> tuple[str, str]:
    """Move the submodule from a name such as "model.Friction" to its module.

    Returns:
        Module that defines the name, such as "pw_elements.contact.model", and the name alone.
    """
    submodule, _, plain_name = name.rpartition(".")
    return f"{module}.{submodule}" if submodule else module, plain_name


def write_reference_pages(
    pages_folder: Path, examples_by_name: dict[str, list[GalleryExample]]
) -> None:
    """Write a page for each public name of the library, and an index in groups.

    Args:
        pages_folder: Folder of the pages, which must not exist.
        examples_by_name: Examples that use each name, by its full name.
    """
    pages_folder.mkdir(parents=True)
    parts = ["# Reference", _INTRODUCTION]
    full_names = []
    for group, (module, names) in _groups_with_ungrouped_names_added().items():
        rows = []
        for qualified_name in names:
            defining_module, name = _move_submodule_from_name_to_module(module, qualified_name)
            public_object = getattr(import_module(defining_module), name)
            full_name = f"{defining_module}.{name}"
            (pages_folder / f"{full_name}.rst").write_text(
                _format_reference_page(defining_module, name, public_object, examples_by_name),
                encoding="utf-8",
            )
            first_paragraph = (inspect.getdoc(public_object) or "").partition("\n\n")[0]
            summary = typeset_plain_text_mathematics(
                " ".join(first_paragraph.split()), "{{sub}}`{}`", "{{sup}}`{}`"
            )
            rows.append(f"[`{name}`]({full_name}.rst)\n: {summary}")
            full_names.append(full_name)
        parts += [f"## {group}", f"`{module}`", "\n\n".join(rows)]
    entries = "\n".join(full_names)
    parts.append(f"```{{toctree}}\n:hidden:\n\n{entries}\n```")
    (pages_folder / "index.md").write_text("\n\n".join(parts) + "\n", encoding="utf-8")


_INTRODUCTION = """Every public name has a page made from its docstring: arguments with shapes of
arrays, results, errors and sources. Any consistent units will do. "Eq. (n)" refers to an equation
of the paper."""


def _format_reference_page(
    module: str, name: str, public_object: object, examples_by_name: dict[str, list[GalleryExample]]
) -> str:
    directive = "autofunction"
    if inspect.isclass(public_object):
        directive = "autoexception" if issubclass(public_object, BaseException) else "autoclass"
    elif not callable(public_object):
        directive = "autodata"
    parts = [
        f"{name}\n{'=' * len(name)}",
        f".. currentmodule:: {module}",
        f".. {directive}:: {name}",
    ]
    if examples := examples_by_name.get(f"{module}.{name}"):
        links = ", ".join(
            f":doc:`{example_heading(example)} </gallery/{example.name}>`" for example in examples
        )
        parts.append(f"**Used in:** {links}")
    return "\n\n".join(parts) + "\n"
