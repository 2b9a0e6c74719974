"""Compare the cost of a small contact problem and of a series of values with DOLFINx' own cost.

    ./run python3 -m tests.speed.series_speed [--runs 20]

The problem is a block in the plane with 462 unknowns, on which a parabola is pressed. The command
prints a table of the smallest CPU times over the runs, and of their ratios to the first row:

- "DOLFINx": form, assembly and LU of the same body, from its mesh on;
- "from the mesh": the library's spaces, stiffness, supports and problem, and one increment;
- "further increment": a push after that increment;
- "value of friction": another friction by `with_changes`, and one increment;
- "value of stiffness": another stiffness by `with_changes`, and one increment.

Each run measures all of these in turn on one thread, and other programs disturb all alike.
"""

import argparse
import time
from collections.abc import Callable

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import ufl
from dolfinx import fem
from dolfinx.fem import petsc
from dolfinx.mesh import locate_entities_boundary

from pw_elements import Body, Material, Reduction, Spaces, assemble_matrix, prescribe
from pw_elements.contact import ContactPair, ContactProblem, Motion, Parabola
from pw_elements.contact.model import ContactState
from pw_elements.meshes import quadrilaterals

YOUNG, POISSON = 1e4, 0.3
PRESS, PUSH = Motion((0, None), force=(0, -40)), Motion((0.01, None), force=(0, -40))


def solve_by_dolfinx_alone() -> None:
    """Assemble and factorise the standard element's stiffness, and solve once."""
    mesh = quadrilaterals(MPI.COMM_SELF, (0, 0), (4, 2), (10, 5))
    V = fem.functionspace(mesh, ("Lagrange", 2, (2,)))
    u, v = ufl.TrialFunction(V), ufl.TestFunction(V)
    mu = YOUNG / (2 * (1 + POISSON))
    lame = YOUNG * POISSON / ((1 + POISSON) * (1 - 2 * POISSON))
    strain = ufl.sym(ufl.grad(u))
    stress = 2 * mu * strain + lame * ufl.tr(strain) * ufl.Identity(2)
    form = fem.form(ufl.inner(stress, ufl.grad(v)) * ufl.dx)
    facets = locate_entities_boundary(mesh, 1, lambda x: np.isclose(x[1], 0))
    dofs = fem.locate_dofs_topological(V, 1, facets)
    held = fem.dirichletbc(np.zeros(2), dofs, V)
    matrix = petsc.assemble_matrix(form, bcs=[held])
    matrix.assemble()
    solver = PETSc.KSP().create(MPI.COMM_SELF)
    solver.setOperators(matrix)
    solver.setType("preonly")
    solver.getPC().setType("lu")
    b, x = matrix.createVecs()
    b.set(1.0)
    solver.solve(b, x)


def make_problem() -> tuple[ContactProblem, PETSc.Mat]:
    """Return the contact problem, made from its mesh on, and its stiffness."""
    mesh = quadrilaterals(MPI.COMM_SELF, (0, 0), (4, 2), (10, 5))
    body = Body(Spaces.petrov_galerkin(mesh), Material(YOUNG, POISSON), "plane strain")
    space = body.spaces.trial
    K = assemble_matrix(body.stiffness())
    base = [prescribe(space, i, lambda x: np.isclose(x[1], 0)) for i in (0, 1)]
    punch = ContactPair(lambda x: np.isclose(x[1], 2), Parabola((2, 2), 8.0), 0.3)
    return ContactProblem(K, Reduction.dirichlet(space, base), punch, space), K


def press(problem: ContactProblem) -> ContactState:
    return problem.step(problem.undeformed, None, PRESS)


def measure(runs: int) -> dict[str, float]:
    """Return the smallest CPU time in seconds of each part over the runs."""
    problem, K = make_problem()
    pressed, value = press(problem), iter(np.linspace(0.2, 0.4, 2 * runs + 2))
    parts: dict[str, Callable[[], object]] = {
        "DOLFINx": solve_by_dolfinx_alone,
        "from the mesh": lambda: press(make_problem()[0]),
        "further increment": lambda: problem.step(pressed, None, PUSH),
        "value of friction": lambda: press(problem.with_changes(friction=next(value))),
        "value of stiffness": lambda: press(problem.with_changes(stiffness=K * next(value))),
    }
    seconds = dict.fromkeys(parts, np.inf)
    for _ in range(runs + 1):
        for name, part in parts.items():
            begin = time.process_time()
            part()
            seconds[name] = min(seconds[name], time.process_time() - begin)
    return seconds


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=20)
    seconds = measure(parser.parse_args().runs)
    print("| part | ms | / DOLFINx |\n| --- | ---: | ---: |")
    for name, smallest in seconds.items():
        print(f"| {name} | {1e3 * smallest:.1f} | {smallest / seconds['DOLFINx']:.1f} |")
