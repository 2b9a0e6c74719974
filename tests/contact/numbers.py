"""Prints contact results that must not depend on the number of processes, as JSON.

Started by test_parallel.py with `mpirun -n 1` and more.
"""

import json
import re

from mpi4py import MPI

import numpy as np
from dolfinx.mesh import CellType, create_box

from pw_elements import Body, Material, Reduction, Spaces, assemble_matrix, prescribe
from pw_elements.contact import (
    ContactPair,
    ContactProblem,
    Motion,
    Plane,
    Sphere,
    SurfacePassed,
    solve_contact,
)
from pw_elements.elasticity import StressState
from tests.contact.cases import Block, Punch, at
from tests.contact.test_matching import Blocks
from tests.contact.two_bodies import Stack
from tests.oracle.random_contact import problem

comm = MPI.COMM_WORLD
numbers = {}


def noted(name, states):
    for k, state in enumerate(states):
        (pair,) = state.pairs
        for field in ("position", "force_normal", "force_tangential", "status", "gap", "slip"):
            numbers[f"{name} {k} {field}"] = np.nan_to_num(getattr(pair, field), posinf=-1.0)
        if len(pair.opposite):
            numbers[f"{name} {k} opposite force"] = pair.opposite_force
        numbers[f"{name} {k} translation"] = pair.translation
        numbers[f"{name} {k} force"] = pair.force
        numbers[f"{name} {k} displacement"] = state.displacement.norm()
        numbers[f"{name} {k} smallness"] = list(vars(state.smallness).values())
        numbers[f"{name} {k} scale"] = list(vars(state.scale).values())


def drag(method=Spaces.petrov_galerkin, poissons_ratio=0.3):
    mesh = create_box(comm, [(-1, -1, 0), (1, 1, 1)], (5, 5, 3), CellType.tetrahedron)
    body = Body(method(mesh), Material(1000.0, poissons_ratio), StressState.SOLID)
    U = body.spaces.trial
    K = assemble_matrix(body.stiffness())
    foot = Reduction.dirichlet(U, [prescribe(U, i, at(2, 0.0)) for i in range(3)])
    motions = [Motion((0, 0, -0.1)), Motion((0.01, 0.02, None), (0, 0, -80.0))]
    ball = ContactPair(at(2, 1.0), Sphere((0, 0, 3), 2.0), 0.3, motions)
    loads = [K.createVecLeft()] * 2
    return solve_contact(K, loads, foot, [ball], U)


def refused(surface, depth):
    """Numbers in the message, the same on all processes, on a surface that passes through."""
    case = Punch(comm=comm)
    pair = ContactPair(at(1, 4.0), surface, 0.3, [Motion((0, -depth))])
    try:
        solve_contact(case.K, case.K.createVecLeft(), case.foot, pair, case.space)
    except SurfacePassed as error:
        (message,) = set(comm.allgather(str(error)))
    return [float(number) for number in re.findall(r"-?[0-9.]*[0-9]", message)]


def stacked():
    """Two blocks, the upper one held by the lower alone; their nodes coincide."""
    blocks = Blocks(divisions=(12, 6), comm=comm)
    held = [prescribe(blocks.space, i, at(1, 0.0)) for i in (0, 1)]
    problem = ContactProblem(
        blocks.K, Reduction.dirichlet(blocks.space, held), blocks.pair(0.3), blocks.space
    )
    pressed = problem.step(problem.undeformed, blocks.load((0.0, -3.0)))
    return [pressed, problem.step(pressed, blocks.load((0.4, -3.0)))]


def mortar(element="petrov_galerkin", nu=0.3):
    """A body in space on another, which it covers in part, pressed and drawn askew."""
    options = {"element": element, "nu": nu, "comm": comm}
    stack = Stack((3, 2), "tetrahedron", upper=(0.13, 0.83), **options)
    held = [prescribe(stack.space, i, at(2, 0.0)) for i in range(3)]
    held += [prescribe(stack.space, i, at(2, 2.0), by) for i, by in enumerate((0.01, 0.0, -0.02))]
    supports = Reduction.dirichlet(stack.space, held)
    load = stack.K.createVecLeft()
    return solve_contact(stack.K, load, supports, stack.pair("lower", 0.2), stack.space)


block = Block(20, comm=comm)
noted("block", block.solve(0.3, 60.0, increments=2))
cut = [len(part) for part in comm.allgather(np.flatnonzero(np.isclose(block.owned()[:, 1], 0.0)))]
assert comm.size == 1 or sum(count > 0 for count in cut) > 1, "the partition spares the contact"
punch = Punch(comm=comm)
motions = [Motion((0, None), (0, -217.3)), Motion((None, None), (21.73, -217.3))]
noted("punch", punch.solve(0.6, motions))
noted("drag", drag())
noted("rubber", drag(Spaces.hybrid, 0.5))
noted("stacked", stacked())
noted("mortar", mortar())
noted("rubber mortar", mortar("hybrid", 0.5))
numbers["ball refused"] = refused(Sphere((0, 6), 2.0), 5.0)
numbers["plate refused"] = refused(Plane((0, 4), (0, -1)), 6.0)
for seed in (158, 316):  # solved without active sets
    noted(f"seed {seed}", problem(seed, comm).solve())
if comm.rank == 0:
    print(json.dumps({name: np.asarray(value).tolist() for name, value in numbers.items()}))
