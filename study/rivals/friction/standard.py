"""The standard element."""

from pw_elements import Spaces
from study.rivals.friction import library
from study.rivals.problem import Form, Problem


def solve(problem: Problem) -> tuple[Form, Form, int]:
    """By the library."""
    return library.solve(problem, Spaces.galerkin(problem.mesh))
