"""The reference: a page for each public name of the library, from its docstring."""

import inspect
from importlib import import_module
from pathlib import Path

from study.publish.site.gallery import Example, short
from study.publish.site.mathematics import typeset

# The names that pages are grouped by; those with a folder are of what public ones take or return
GROUPS: dict[str, tuple[str, tuple[str, ...]]] = {
    "Spaces and elements": (
        "pw_elements",
        (
            "Spaces",
            "test_space",
            "as_function",
            "split",
            "cell_measure",
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
CONSTANTS = {"HELD", "OPEN", "STICK", "SLIP"}  # of contact, which the page of PairState tells


def public() -> list[str]:
    """Return the full names of all that has a page."""
    return [f"{module}.{name}" for module, names in _groups().values() for name in names]


def _groups() -> dict[str, tuple[str, tuple[str, ...]]]:
    """Return the groups, and one for each module with public names that none of them has."""
    groups = dict(GROUPS)
    for module in ("pw_elements", "pw_elements.contact", "pw_elements.meshes"):
        named = {name for of, names in GROUPS.values() if of == module for name in names}
        if others := sorted({*import_module(module).__all__} - named - CONSTANTS):
            groups[f"Others of {module}"] = (module, tuple(others))
    return groups


def _placed(module: str, name: str) -> tuple[str, str]:
    """Return the module that has a name of a group, and the name without its folder."""
    inner, _, plain = name.rpartition(".")
    return f"{module}.{inner}" if inner else module, plain


def write(pages: Path, used: dict[str, list[Example]]) -> None:
    """Write the reference's pages.

    Args:
        pages: Their folder.
        used: The examples that use each public name.
    """
    pages.mkdir(parents=True)
    parts = ["# Reference", _INTRODUCTION]
    tree = []
    for group, (module, names) in _groups().items():
        rows = []
        for placed in names:
            where, name = _placed(module, placed)
            thing = getattr(import_module(where), name)
            full = f"{where}.{name}"
            (pages / f"{full}.rst").write_text(_page(where, name, thing, used), encoding="utf-8")
            line = (inspect.getdoc(thing) or "").partition("\n\n")[0]
            what = typeset(" ".join(line.split()), "{{sub}}`{}`", "{{sup}}`{}`")
            rows.append(f"[`{name}`]({full}.rst)\n: {what}")
            tree.append(full)
        parts += [f"## {group}", f"`{module}`", "\n\n".join(rows)]
    entries = "\n".join(tree)
    parts.append(f"```{{toctree}}\n:hidden:\n\n{entries}\n```")
    (pages / "index.md").write_text("\n\n".join(parts) + "\n", encoding="utf-8")


_INTRODUCTION = """Every public name has a page made from its docstring: arguments with shapes of
arrays, results, errors and sources. Any consistent units will do. "Eq. (n)" refers to an equation
of the paper."""


def _page(module: str, name: str, thing: object, used: dict[str, list[Example]]) -> str:
    kind = "autofunction"
    if inspect.isclass(thing):
        kind = "autoexception" if issubclass(thing, BaseException) else "autoclass"
    elif not callable(thing):
        kind = "autodata"
    parts = [
        f"{name}\n{'=' * len(name)}",
        f".. currentmodule:: {module}",
        f".. {kind}:: {name}",
    ]
    if one := used.get(f"{module}.{name}"):
        links = ", ".join(f":doc:`{short(e)} </gallery/{e.name}>`" for e in one)
        parts.append(f"**Used in:** {links}")
    return "\n\n".join(parts) + "\n"
