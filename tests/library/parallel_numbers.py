"""Prints numbers that must not depend on the number of processes, as JSON.

Started by test_parallel.py with `mpirun -n 1` and more.
"""

import json

from mpi4py import MPI

import numpy as np
import ufl
from dolfinx import fem
from dolfinx.mesh import CellType, create_box

from pw_elements import (
    Body,
    Material,
    PetrovGalerkinProblem,
    Reduction,
    Spaces,
    assemble_matrix,
    assemble_scalar,
    assemble_vector,
    boundary_measure,
    buckling,
    force_transfer,
    forces_along,
    lumped_mass,
    nodal_flux,
    prescribe,
    reactions,
    solve,
    split,
    vibration_modes,
)
from pw_elements.algebra import symmetric_part
from pw_elements.contact import ContactPair, Plane, solve_contact
from pw_elements.elasticity import StressState, nodal_load
from pw_elements.meshes import curved, mapped, quadrilaterals, triangles
from pw_elements.spaces import macro_element
from study.discretisation import discretise
from study.verification.t_identity import distorted
from study.verification.v15_layers import error, layered

comm = MPI.COMM_WORLD
numbers: dict[str, list[float] | float] = {}


def left(x):
    return np.isclose(x[0], 0.0)


def corner(x):
    return left(x) & np.isclose(x[1], x[1].min() if x.size else 0.0)


def beam(method, name):
    mesh = triangles(comm, (0.0, -0.5), (8.0, 0.5), (16, 4), "crossed")
    body = Body(method(mesh), Material(2.0, 0.3), StressState.PLANE_STRESS)
    U = body.spaces.trial
    right = boundary_measure(mesh, lambda x: np.isclose(x[0], 8.0))
    K = assemble_matrix(body.stiffness())
    f = assemble_vector(body.surface_load((-1.0, 0.0), right))
    f.axpy(1.0, nodal_load(U, lambda x: np.isclose(x[0], 8.0) & np.isclose(x[1], 0.0), (0, 1e-3)))
    supports = Reduction.dirichlet(U, [prescribe(U, 0, left), prescribe(U, 1, left, 0.01)])
    a = solve(K, f, supports)
    r = forces_along(U, reactions(K, a, f), left, axis=1)
    numbers[f"{name}_displacement_norm"] = a.norm()
    numbers[f"{name}_reactions"] = r.force.ravel().tolist()
    numbers[f"{name}_stiffness_norm"] = K.norm()

    u = fem.Function(U)
    u.x.array[: a.getLocalSize()] = a.array_r
    u.x.scatter_forward()
    for form in ("G", "J"):
        K_sigma = assemble_matrix(body.initial_stress(body.stress(u), form))
        numbers[f"{name}_buckling_{form}"] = buckling(K, K_sigma, supports, 2).factors.tolist()
    S = symmetric_part(K_sigma)
    numbers[f"{name}_symmetrised"] = buckling(
        symmetric_part(K), S, supports, 1, symmetrised=True
    ).factors.tolist()
    M = assemble_matrix(body.mass())
    numbers[f"{name}_mass_norm"] = M.norm()
    for symmetrised in (False, True):
        modes = vibration_modes(K, M, supports, 3, symmetrised)
        numbers[f"{name}_frequencies_{symmetrised}"] = modes.eigenvalues.tolist()
    free = vibration_modes(K, M, Reduction.dirichlet(U, []), 4)
    numbers[f"{name}_rigid"] = free.rigid
    numbers[f"{name}_free_frequencies"] = free.eigenvalues[3:].tolist()


def identity():
    mesh = mapped(triangles(comm, (0.0, 0.0), (1.0, 1.0), (7, 6)), distorted)
    galerkin, pw = Spaces.galerkin(mesh), Spaces.petrov_galerkin(mesh)
    material = Material(1.0, 0.3)
    K = assemble_matrix(Body(galerkin, material, StressState.PLANE_STRESS).stiffness())
    K_pw = assemble_matrix(Body(pw, material, StressState.PLANE_STRESS).stiffness())
    difference = force_transfer(galerkin.trial).matMult(K) - K_pw
    numbers["identity"] = difference.norm() / K_pw.norm()


def element(name):
    def build(cell):
        make = quadrilaterals if cell == "quadrilateral" else triangles
        return mapped(make(comm, (0.0, 0.0), (1.0, 1.0), (7, 5)), distorted)

    body = discretise(name, build, Material(1.0, 0.3), StressState.PLANE_STRESS)
    U, K = body.space, body.K
    f = assemble_vector(body.body.body_load((0.3, -1.0)))
    supports = body.supports([prescribe(U, i, left, 0.01 * i) for i in (0, 1)])
    a = solve(K, f, supports)
    numbers[f"{name}_displacement_norm"] = a.norm()
    numbers[f"{name}_stiffness_norm"] = supports.matrix(K).norm()
    r = forces_along(U, reactions(K, a, f), left, axis=1)
    numbers[f"{name}_reactions"] = r.force.ravel().tolist()
    wall = ContactPair(left, Plane((0.0, 0.0), (1.0, 0.0)), 0.4)
    f = assemble_vector(body.body.body_load((-1.0, -0.35)))
    (state,) = solve_contact(K, f, body.supports([]), [wall], U)
    numbers[f"{name}_contact"] = state.pairs[0].force_normal.tolist()
    numbers[f"{name}_contact_displacement_norm"] = state.displacement.norm()
    M = assemble_matrix(body.body.mass())
    for left_matrix in ("transposed", "same"):
        modes = vibration_modes(K, M, supports.guyan(left_matrix), 3)
        numbers[f"{name}_guyan_{left_matrix}"] = modes.eigenvalues.tolist()
    if name == "pw-Q8":
        lumped = vibration_modes(K, lumped_mass(M, U), supports.guyan("transposed"), 3)
        numbers[f"{name}_lumped"] = lumped.eigenvalues.tolist()


def solid():
    mesh = create_box(comm, [(0, 0, 0), (1, 1, 2)], (3, 3, 5), CellType.tetrahedron)
    body = Body(Spaces.petrov_galerkin(mesh), Material(1.0, 0.3), StressState.SOLID)
    U = body.spaces.trial
    K = assemble_matrix(body.stiffness())
    f = assemble_vector(body.body_load((0.0, 0.3, -1.0)))
    foot = [prescribe(U, i, lambda x: np.isclose(x[2], 0.0)) for i in range(3)]
    numbers["solid"] = solve(K, f, Reduction.dirichlet(U, foot)).norm()
    nodes = fem.locate_dofs_geometrical(U, lambda x: np.isclose(x[2], 0.0))
    whole = [fem.dirichletbc(np.zeros(3), nodes, U)]
    numbers["solid_held_as_vectors"] = solve(K, f, Reduction.dirichlet(U, whole)).norm()
    free = vibration_modes(K, assemble_matrix(body.mass()), Reduction.dirichlet(U, []), 8)
    numbers["solid_rigid"] = free.rigid
    numbers["solid_frequencies"] = free.eigenvalues[6:].tolist()


def tube():
    mesh = curved(triangles(comm, (1.0, 0.0), (2.0, 1.0), (6, 5)), distorted)
    body = Body(Spaces.petrov_galerkin(mesh), Material(1.0, 0.3), StressState.AXISYMMETRIC)
    K, M = assemble_matrix(body.stiffness()), assemble_matrix(body.mass())
    numbers["tube_stiffness_norm"], numbers["tube_mass_norm"] = K.norm(), M.norm()
    W = fem.functionspace(mesh, macro_element("triangle"))
    w = fem.Function(W)
    w.interpolate(lambda x: np.sin(x[0]) * x[1])
    integral = fem.assemble_scalar(fem.form(w**2 * ufl.dx))
    numbers["macro_integral"] = comm.allreduce(integral)


def rubber():
    mesh = create_box(comm, [(0, 0, 0), (1, 1, 1)], (3, 3, 3), CellType.tetrahedron)
    spaces = Spaces.petrov_galerkin(mesh)
    U, u, v = spaces.trial, fem.Function(spaces.trial), ufl.TestFunction(spaces.test)
    F = ufl.Identity(3) + ufl.grad(u)
    inverse = ufl.inv(F).T
    stress = F - inverse + ufl.ln(ufl.det(F)) * inverse
    residual = ufl.inner(stress, ufl.grad(v)) * ufl.dx(metadata={"quadrature_degree": 3})
    depth = fem.Constant(mesh, -0.3)
    conditions = [prescribe(U, i, lambda x: np.isclose(x[2], 0.0)) for i in range(3)]
    conditions.append(prescribe(U, 2, lambda x: np.isclose(x[2], 1.0), depth))
    problem = PetrovGalerkinProblem(residual, u, conditions)
    problem.solve(depth, increments=2)
    numbers["rubber_reactions"] = problem.reactions().norm()
    traction = nodal_flux(spaces, problem.reactions(), lambda x: np.isclose(x[2], 0.0))
    numbers["rubber_tractions"] = traction.flux.ravel().tolist()
    numbers["rubber_volume"] = assemble_scalar(ufl.det(F) * ufl.dx)
    numbers["rubber_iterations"] = [len(part.corrections) for part in problem.increments]


def hybrid(state, name):
    if state == "solid":
        mesh = create_box(comm, [(0, 0, 0), (1, 1, 2)], (3, 3, 5), CellType.tetrahedron)
    else:
        mesh = mapped(triangles(comm, (0.0, 0.0), (1.0, 1.0), (7, 6)), distorted)
    body = Body(Spaces.hybrid(mesh), Material(2e9, 0.5), state)
    W = body.spaces.trial
    dim = mesh.geometry.dim
    K, f = assemble_matrix(body.stiffness()), assemble_vector(body.body_load([3e6] * dim))
    f.axpy(1.0, nodal_load(W, left, [2e6] * dim))
    held = Reduction.dirichlet(W, [prescribe(W, k, left, 0.01 * k) for k in range(dim)])
    a = solve(K, f, held)
    for field, function in zip(("displacement", "pressure"), split(W, a), strict=True):
        numbers[f"{name}_{field}"] = function.x.petsc_vec.norm()
    numbers[f"{name}_reactions"] = reactions(K, a, f).norm()


beam(Spaces.galerkin, "galerkin")
beam(Spaces.petrov_galerkin, "pw")
identity()
for name in ("pw-Q8", "pw-Q9", "composite-T6"):
    element(name)
solid()
tube()
rubber()
for state in ("plane strain", "axisymmetric", "solid"):
    hybrid(state, f"hybrid {state}")
for cell in (CellType.triangle, CellType.tetrahedron):
    assert error(Spaces.hybrid, layered(comm, cell), split_pressure=True) < 1e-12
if comm.rank == 0:
    print(json.dumps({name: np.asarray(value).tolist() for name, value in numbers.items()}))
