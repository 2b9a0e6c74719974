"""Prints numbers of the iterative solver that must not depend on the number of processes."""

import json

from mpi4py import MPI

import numpy as np
from dolfinx.mesh import CellType, create_box

from pw_elements import (
    Body,
    Iterative,
    Material,
    NotConverged,
    Reduction,
    SingularSystem,
    Spaces,
    assemble_matrix,
    assemble_vector,
    prescribe,
    solve,
    split,
    vibration_modes,
)
from pw_elements.contact import solve_contact
from pw_elements.contact.iteration import krylov
from pw_elements.solvers import iterative
from tests.contact.iterative import CASES, STACKED, Solid, nearly_sliding
from tests.contact.two_bodies import Stack

comm = MPI.COMM_WORLD
numbers: dict[str, list[float] | float | str] = {}


def supported(cell):
    mesh = create_box(comm, [(0, 0, 0), (2, 1, 1)], (6, 3, 3), CellType[cell])
    body = Body(Spaces.petrov_galerkin(mesh), Material(1.0, 0.3), "solid")
    U = body.spaces.trial
    K = assemble_matrix(body.stiffness())
    f = assemble_vector(body.body_load((0.0, 0.3, -1.0)))
    foot = [prescribe(U, i, lambda x: np.isclose(x[0], 0.0), 0.1 * i) for i in range(3)]
    held = Reduction.dirichlet(U, foot)
    numbers[f"{cell}_displacement_norm"] = solve(K, f, held, Iterative()).norm()
    modes = vibration_modes(K, assemble_matrix(body.mass()), held, 3, solver=Iterative())
    numbers[f"{cell}_frequencies"] = modes.eigenvalues.tolist()
    try:
        solve(K, f, Reduction.dirichlet(U, foot[:2]), Iterative())
    except SingularSystem:
        numbers[f"{cell}_free"] = 1.0


def hybrid(cell):
    mesh = create_box(comm, [(0, 0, 0), (2, 1, 1)], (6, 3, 3), CellType[cell])
    body = Body(Spaces.hybrid(mesh), Material(2e9, 0.5), "solid")
    W = body.spaces.trial
    f = assemble_vector(body.body_load((0.0, 3e8, -1e9)))
    foot = [prescribe(W, i, lambda x: np.isclose(x[0], 0.0), 0.1 * i) for i in range(3)]
    held = Reduction.dirichlet(W, foot)
    a = solve(assemble_matrix(body.stiffness()), f, held, Iterative())
    for field, function in zip(("displacement", "pressure"), split(W, a), strict=True):
        numbers[f"{cell} hybrid {field}"] = function.x.petsc_vec.norm()


def contact(case, body, what=""):
    for k, state in enumerate(solve_contact(*body.arguments(case), solver=Iterative())):
        numbers[f"{what}{case} {k} displacement_norm"] = state.displacement.norm()
        for number, pair in enumerate(state.pairs):
            name = f"{what}{case} {k} {number}"
            numbers[f"{name} statuses"] = np.bincount(pair.status, minlength=3).tolist()
            numbers[f"{name} force"] = float(np.abs(pair.force).max())
            numbers[f"{name} largest"] = pair.force_normal.max()


def nested():
    (coarse,) = solve_contact(*Solid(n=2, comm=comm).arguments("rough floor"), solver=Iterative())
    solid = Solid(n=4, comm=comm)
    solid.K = assemble_matrix(solid.body.stiffness(), blocked=True)
    fine = solid.arguments("rough floor")
    (state,) = solve_contact(*fine, solver=Iterative(), start=coarse)
    numbers["nested"] = state.displacement.norm()
    held = solid.foot()
    numbers["of K"] = solve(solid.K, solid.pushed(), held, Iterative()).norm()
    numbers["users of K"] = solid.K.getRefCount()  # solvers have let go of it


def hardly_held():
    arguments = nearly_sliding(Solid(n=2, comm=comm))
    for k, state in enumerate(solve_contact(*arguments, solver=Iterative())):
        numbers[f"sliding {k}"] = state.displacement.norm()
        numbers[f"sliding {k} statuses"] = np.bincount(state.pairs[0].status).tolist()


def by_auto():
    """Without anchors Krylov's method gives up in the second increment."""
    iterative._MANY, krylov._ENOUGH = 1, 0
    arguments = nearly_sliding(Solid(n=2, comm=comm))
    for k, state in enumerate(solve_contact(*arguments)):
        numbers[f"auto {k}"] = [state.displacement.norm(), state.report.factorisations]
    iterative.free_memory = lambda _: 1e6
    try:
        solve_contact(*arguments)
    except NotConverged as error:
        numbers["words that differ"] = len(set(comm.allgather(str(error)))) - 1


def two_bodies(case, what="", **body):
    """The upper one is the slave."""
    stack = Stack((4, 3), "tetrahedron", upper=(0.13, 0.83), comm=comm, **body)
    arguments = STACKED[case](stack, "upper")
    (state,) = solve_contact(*arguments, solver=Iterative())
    numbers[f"{what}{case} displacement_norm"] = state.displacement.norm()
    for number, pair in enumerate(state.pairs):
        name = f"{what}{case} {number}"
        numbers[f"{name} statuses"] = np.bincount(pair.status, minlength=3).tolist()
        numbers[f"{name} force_normal"] = pair.force_normal.tolist()


supported("tetrahedron")
supported("hexahedron")
hybrid("tetrahedron")
hybrid("hexahedron")
for case in CASES:
    contact(case, Solid(comm=comm))
for case in ("sphere", "plate by forces"):
    contact(case, Solid(method=Spaces.hybrid, comm=comm, nu=0.5), "hybrid ")
nested()
hardly_held()
for case in STACKED:
    two_bodies(case, ratio=0.5)
two_bodies("held by contact", "hybrid ", element="hybrid", nu=0.5)
by_auto()
if comm.rank == 0:
    print(json.dumps(numbers))
