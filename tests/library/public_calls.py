"""Correct calls of all public collective functions, for any number of processes."""

import inspect
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import ufl
from dolfinx import fem
from dolfinx.mesh import meshtags

import pw_elements
import pw_elements.contact
import pw_elements.meshes
from pw_elements import (
    Body,
    Direct,
    Iterative,
    Material,
    PetrovGalerkinProblem,
    Reduction,
    Sibling,
    Spaces,
    SurfaceNodes,
    as_function,
    assemble_matrix,
    boundary_measure,
    lumped_mass,
    prescribe,
    reactions,
    solve,
)
from pw_elements.contact import ContactFields, ContactProblem, Motion, Plane
from pw_elements.meshes import triangles
from tests.contact.cases import BlockOnFloor, on_plane
from tests.contact.test_law_fields import make_temperature, warm_floor_pair

ROOT = Path(__file__).parents[2]
BOTTOM_MARKER, TOP_MARKER = on_plane(1, 0.0), on_plane(1, 2.0)


def collect_public_callables_by_name():
    """Return a dictionary of public functions, classes and methods by their names."""
    objects = {}
    for module in (pw_elements, pw_elements.contact, pw_elements.meshes):
        for name in module.__all__:
            obj = getattr(module, name)
            if not inspect.isclass(obj):
                objects |= {name: obj} if callable(obj) else {}
            elif not issubclass(obj, Exception):
                objects[name] = obj
                for method, member in vars(obj).items():
                    is_private_or_property = method.startswith("_") or isinstance(member, property)
                    if not is_private_or_property and callable(getattr(obj, method)):
                        objects[f"{name}.{method}"] = getattr(obj, method)
    return objects


def make_valid_collective_calls(comm):
    """Return a valid call (function, keyword arguments) of each collective function, by name."""
    block = BlockOnFloor(8, comm=comm)
    w = SimpleNamespace(block=block, body=block.body, U=block.space, K=block.K, mesh=block.mesh)
    w.spaces, w.load, w.pair = block.body.spaces, block.pressure_load, block.floor_pair(0.3)
    w.foot = [prescribe(w.U, i, BOTTOM_MARKER) for i in (0, 1)]
    w.held = Reduction.dirichlet(w.U, w.foot)
    w.M = assemble_matrix(w.body.mass())
    w.a = solve(w.K, w.load, w.held)
    w.r = reactions(w.K, w.a, w.load)
    cells = np.arange(w.mesh.topology.index_map(2).size_local, dtype=np.int32)
    w.tags = meshtags(w.mesh, 2, cells, np.ones(len(cells), dtype=np.int32))
    galerkin = Body(Spaces.galerkin(w.mesh), Material(1000.0, 0.3), "plane strain")
    V = galerkin.spaces.trial
    K, M = assemble_matrix(galerkin.stiffness()), assemble_matrix(galerkin.mass())
    sibling = Sibling.from_space(V)
    S, lumped = sibling.matrix(K), lumped_mass(sibling.matrix(M), V)
    zero_vector = S.createVecRight()
    ds = boundary_measure(w.mesh, TOP_MARKER)
    problem = ContactProblem(w.K, w.block.no_supports, w.pair, w.U)
    state = problem.step(problem.undeformed, w.load)
    warm_floor = warm_floor_pair(make_temperature(w.mesh, lambda x: 10 * x[0]))
    warm = ContactProblem(w.K, w.block.no_supports, warm_floor, w.U)
    warm_state = warm.step(warm.undeformed, w.load)
    u, v = fem.Function(w.U), ufl.TestFunction(w.spaces.test)
    depth = fem.Constant(w.mesh, 0.01)
    F = ufl.inner(ufl.grad(u), ufl.grad(v)) * ufl.dx
    conditions = [*w.foot, prescribe(w.U, 1, TOP_MARKER, depth)]
    nonlinear = PetrovGalerkinProblem(F, u, conditions)
    floor = pw_elements.contact.ContactPair(BOTTOM_MARKER, Plane((0, 0), (0, 1)))
    top_conditions = [prescribe(w.U, i, TOP_MARKER) for i in (0, 1)]
    residual_arguments = {"residual": F, "u": u, "conditions": top_conditions, "pairs": floor}
    displacement_function, fields = as_function(w.U, w.a), ContactFields.from_state(state, w.body)
    condensed_nodes = np.zeros(0, dtype=np.int32)
    x = ufl.SpatialCoordinate(w.mesh)
    rectangle_arguments = {"comm": comm, "lower": (0, 0), "upper": (1, 1), "divisions": (4, 3)}
    eigenproblem_arguments = {
        "K": w.K,
        "M": w.M,
        "reduction": w.held,
        "count": 1,
        "symmetrised": False,
    }
    contact_arguments = {"K": w.K, "reduction": block.no_supports, "pairs": w.pair, "space": w.U}
    option_arguments = {"max_iterations": 50, "solver": None, "remedies": ("springs",)}
    body_arguments = {"mesh": w.mesh, "material": Material(1.0, 0.3), "state": "plane strain"}
    impact_arguments = {
        "K": S,
        "M": lumped,
        "reduction": sibling.dirichlet([]),
        "pairs": floor,
        "space": V,
    }
    return {
        "Body": (
            Body,
            {"spaces": w.spaces, "material": Material(1.0, 0.3), "state": "plane stress"}
            | {"thickness": 1.0, "quadrature_degree": None},
        ),
        "Body.from_mesh": (Body.from_mesh, {**body_arguments, "parts": None}),
        "Body.stiffness": (w.body.stiffness, {}),
        "Body.mass": (w.body.mass, {}),
        "Body.surface_load": (w.body.surface_load, {"traction": (0.0, 1.0), "surface": ds}),
        "Body.body_load": (w.body.body_load, {"force": fem.Constant(w.mesh, (0.0, 1.0))}),
        "Body.geometric_stiffness": (
            w.body.geometric_stiffness,
            {"stress": w.body.stress(displacement_function), "form": "G"},
        ),
        "ContactFields.from_state": (ContactFields.from_state, {"state": state, "body": w.body}),
        "ContactFields.fill": (fields.fill, {"state": state}),
        "ContactFields.error_indicator": (fields.error_indicator, {}),
        "ContactProblem": (
            ContactProblem,
            contact_arguments | option_arguments | {"callback": None},
        ),
        "ContactProblem.of_residual": (
            ContactProblem.of_residual,
            residual_arguments
            | {"max_iterations": 25, "solver": Direct()}
            | {"history": [displacement_function], "update": None, "callback": None},
        ),
        "ContactProblem.step": (
            problem.step,
            {"state": state, "load": w.load, "motions": [Motion((0, 0))]},
        ),
        "ContactProblem.sensitivity": (
            problem.sensitivity,
            {"states": [problem.undeformed, state], "outputs": [("force", 0, 1)]}
            | {"parameters": [(w.load, [0.0, 1.0])], "loads": [w.load], "weights": [[1.0]]},
        ),
        "ContactProblem.differentiate_forces_by_fields": (
            warm.differentiate_forces_by_fields,
            {"start": warm.undeformed, "state": warm_state, "pair": 0},
        ),
        "ContactProblem.with_changes": (
            problem.with_changes,
            {"friction": 0.2, "stiffness": w.K},
        ),
        "ContactProblem.save": (problem.save, {"state": state, "path": "/nowhere/state.npz"}),
        "ContactProblem.load": (problem.load, {"path": "/nowhere/state.npz"}),
        "ContactProblem.release": (problem.release, {}),
        "Direct.prepare": (Direct().prepare, {"matrix": w.K, "symmetric": False}),
        "Iterative.prepare": (
            Iterative().prepare,
            {"matrix": w.K, "symmetric": False, "supports": w.held.supports},
        ),
        "Material.by_tag": (
            Material.by_tag,
            {"mesh": w.mesh, "cell_tags": w.tags, "materials": {1: Material(1.0, 0.3)}},
        ),
        "PetrovGalerkinProblem": (
            PetrovGalerkinProblem,
            {"residual": F, "u": u, "conditions": conditions, "solver": Direct()},
        ),
        "PetrovGalerkinProblem.solve": (nonlinear.solve, {"load": depth, "increments": 1}),
        "PetrovGalerkinProblem.reactions": (nonlinear.reactions, {}),
        "Reduction": (
            Reduction,
            {"left": w.held.left, "right": w.held.right, "inner_flexibility": None}
            | {"offset": w.held.offset, "space": w.U, "supports": w.held.supports},
        ),
        "Reduction.expand": (w.held.expand, {"reduced": w.held.right.createVecRight()}),
        "Reduction.dirichlet": (Reduction.dirichlet, {"space": w.U, "conditions": conditions}),
        "Reduction.condensation": (
            Reduction.condensation,
            {"K": w.K, "space": w.U, "nodes": condensed_nodes, "conditions": w.foot},
        ),
        "Reduction.with_offset_for_load": (w.held.with_offset_for_load, {"K": w.K, "f": w.load}),
        "Reduction.matrix": (w.held.matrix, {"K": w.K}),
        "Reduction.load": (w.held.load, {"K": w.K, "f": w.load}),
        "Sibling.from_space": (Sibling.from_space, {"space": V}),
        "Sibling.matrix": (sibling.matrix, {"standard": K}),
        "Sibling.load": (sibling.load, {"standard": zero_vector}),
        "Sibling.displacement": (sibling.displacement, {"coefficients": zero_vector}),
        "Sibling.coefficients": (sibling.coefficients, {"displacement": zero_vector}),
        "Sibling.dirichlet": (sibling.dirichlet, {"conditions": []}),
        "Spaces": (Spaces, {"trial": w.U, "test": w.spaces.test, "parts": None}),
        "Spaces.petrov_galerkin": (Spaces.petrov_galerkin, {"mesh": w.mesh, "components": 2}),
        "Spaces.galerkin": (Spaces.galerkin, {"mesh": w.mesh, "components": None}),
        "Spaces.hybrid": (Spaces.hybrid, {"mesh": w.mesh, "parts": w.tags}),
        "SurfaceNodes.from_body": (
            SurfaceNodes.from_body,
            {"body": w.body, "where": BOTTOM_MARKER, "area_stretch": None},
        ),
        "SurfaceNodes.from_scalar_spaces": (
            SurfaceNodes.from_scalar_spaces,
            {"spaces": Spaces.galerkin(w.mesh, 0), "where": BOTTOM_MARKER, "depth": 2.0},
        ),
        "as_function": (
            as_function,
            {"space": w.U, "values": w.a, "name": "u", "out": displacement_function},
        ),
        "assemble_matrix": (assemble_matrix, {"form": w.body.stiffness(), "blocked": False}),
        "assemble_scalar": (pw_elements.assemble_scalar, {"form": depth * x[0] * ufl.dx(w.mesh)}),
        "assemble_vector": (pw_elements.assemble_vector, {"form": w.body.body_load((0.0, 1.0))}),
        "boundary_measure": (
            boundary_measure,
            {"mesh": w.mesh, "where": BOTTOM_MARKER, "quadrature_degree": 4},
        ),
        "buckling": (
            pw_elements.buckling,
            {"K": w.K, "K_sigma": w.M, "reduction": w.held, "count": 1, "symmetrised": True}
            | {"solver": Direct()},
        ),
        "critical_step": (
            pw_elements.critical_step,
            {"K": S, "M": lumped, "reduction": sibling.dirichlet([])},
        ),
        "curved_mesh": (pw_elements.meshes.curved_mesh, {"mesh": w.mesh, "point_map": lambda x: x}),
        "draw": (
            pw_elements.draw,
            {
                "mesh": w.mesh,
                "values": displacement_function[0],
                "displacement": displacement_function,
                "scale": 1.0,
                "axes": None,
            }
            | {"label": "", "colours": "viridis", "limits": (0.0, 1.0), "view": (25.0, -60.0)}
            | {"edges": True},
        ),
        "force_transfer": (pw_elements.force_transfer, {"space": V}),
        "forces_along": (
            pw_elements.forces_along,
            {"space": w.U, "forces": w.r, "where": BOTTOM_MARKER},
        ),
        "from_file": (
            pw_elements.meshes.from_file,
            {"path": str(ROOT / "examples/gasket.msh"), "comm": comm},
        ),
        "from_gmsh": (
            pw_elements.meshes.from_gmsh,
            {"comm": comm, "source": str(ROOT / "examples/gasket.msh")},
        ),
        "history_space": (
            pw_elements.history_space,
            {"spaces": w.spaces, "shape": (2,), "quadrature_degree": 4},
        ),
        "lumped_mass": (lumped_mass, {"M": w.M, "space": w.U}),
        "move_nodes": (pw_elements.meshes.move_nodes, {"mesh": w.mesh, "point_map": lambda x: x}),
        "nodal_flux": (
            pw_elements.nodal_flux,
            {"spaces": w.spaces, "reactions": w.r, "where": BOTTOM_MARKER, "area": "geometric"}
            | {"depth": 1.0},
        ),
        "plot": (
            pw_elements.contact.plot,
            {"state": state, "body": w.body, "pair": 0, "axes": None, "along": 0}
            | {"opposite": False, "unit": ""},
        ),
        "prescribe": (
            prescribe,
            {"space": w.U, "component": 1, "where": BOTTOM_MARKER, "value": depth},
        ),
        "quadrilaterals": (pw_elements.meshes.quadrilaterals, rectangle_arguments),
        "reactions": (reactions, {"K": w.K, "a": w.a, "f": w.load}),
        "solve": (
            solve,
            {"K": w.K, "f": w.load, "reduction": w.held, "solver": Direct({"ksp_rtol": 1.0})},
        ),
        "solve_contact": (
            pw_elements.contact.solve_contact,
            contact_arguments | option_arguments | {"loads": [w.load], "callback": None},
        ),
        "solve_for_values": (
            pw_elements.contact.solve_for_values,
            {"name": "mu", "values": [0.1, 0.2], "solve": lambda mu: {"result": 2 * mu}}
            | {"path": "/nowhere/table.csv", "comm": comm},
        ),
        "solve_impact": (
            pw_elements.contact.solve_impact,
            impact_arguments
            | {"duration": 1e-3, "velocity": zero_vector, "load": None, "paths": []}
            | {"displacement": None, "step": None, "frames": 0, "max_steps": 1000},
        ),
        "split": (pw_elements.split, {"space": Spaces.hybrid(w.mesh).trial, "values": w.a}),
        "test_space": (pw_elements.test_space, {"trial": w.U}),
        "triangles": (triangles, rectangle_arguments | {"pattern": "crossed"}),
        "vibration_modes": (
            pw_elements.vibration_modes,
            eigenproblem_arguments | {"solver": "auto"},
        ),
        "write": (
            pw_elements.contact.write,
            {"path": "/nowhere/x.bp", "states": [state], "body": w.body, "times": [0.0]},
        ),
    }


def yield_altered_values(value):
    """Yield values other than the given one: valid ones of its type, then invalid ones."""
    if isinstance(value, bool):
        yield not value
    elif isinstance(value, int | float):
        yield value + 1
        yield value * (1 + 1e-15) if value else 1e-300
    elif isinstance(value, str):
        yield value + "x"
    elif isinstance(value, np.ndarray):
        yield value + 1 if len(value) else np.array([10**6])
    elif isinstance(value, tuple | list) and value and isinstance(value[0], int | float):
        yield [*value[:-1], value[-1] + 1]
        yield value[:-1]
    elif isinstance(value, tuple | list):
        yield [*value, *value] or [None]
        yield value[1:] if value else None
    elif isinstance(value, dict):
        yield {key + 1: material for key, material in value.items()}
    elif isinstance(value, fem.Constant):
        yield fem.Constant(value.ufl_domain(), 2 * value.value + 1)
    elif isinstance(value, Material):
        yield Material(2.0, value.poissons_ratio)
        yield Material(1.0, 0.4)
    elif isinstance(value, Motion):
        yield Motion((0.0, 0.1))
    elif isinstance(value, Direct):
        yield Iterative()
        yield Direct({"ksp_rtol": 0.5})
    elif isinstance(value, ufl.Form):
        yield 2 * value
        yield value + value
    elif isinstance(value, ufl.core.expr.Expr) and not isinstance(value, fem.Function):
        yield 2 * value
    yield object()
    if value is not None:
        yield None
