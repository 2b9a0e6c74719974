"""What "auto" takes, and what it does where Krylov's method gives up."""

import logging
import os

from mpi4py import MPI

import numpy as np
import pytest

from pw_elements import (
    Body,
    Direct,
    Iterative,
    Material,
    NotConverged,
    Reduction,
    Spaces,
    as_function,
    assemble_matrix,
    assemble_vector,
    buckling,
    prescribe,
    solve,
    vibration_modes,
)
from pw_elements.contact import NoEquilibrium, solve_contact
from pw_elements.contact.iteration import krylov
from pw_elements.solvers import iterative
from tests.contact.cases import at
from tests.contact.iterative import Solid, nearly_sliding
from tests.library.test_iterative import box, case, difference

GAVE_UP = "auto: Iterative gave up, Direct goes on; factors take some"


@pytest.fixture
def small(monkeypatch):
    """Bodies of any size are large."""
    monkeypatch.setattr(iterative, "_MANY", 1)
    monkeypatch.setattr(iterative, "_MANY_FOR_MODES", 1)
    monkeypatch.setattr(krylov, "_ENOUGH", 0)  # GMRES then fails where no node sticks


@pytest.fixture
def impatient(monkeypatch):
    """And iterations are few."""
    monkeypatch.setattr(iterative, "_MANY", 1)
    monkeypatch.setattr(iterative, "_MANY_FOR_MODES", 1)
    monkeypatch.setattr(iterative, "Iterative", lambda: Iterative(options={"ksp_max_it": 3}))


@pytest.mark.usefixtures("small")
def test_contact_goes_on_with_factors(caplog):
    arguments = nearly_sliding(Solid(n=2))
    known = solve_contact(*arguments, solver=Direct())
    with pytest.raises(NotConverged, match=r"use Direct\(\)") as failed:
        solve_contact(*arguments, solver=Iterative())
    assert "auto" not in str(failed.value)
    told = []
    with caplog.at_level(logging.INFO, logger="pw_elements"):
        states = solve_contact(*arguments, callback=told.append)
    methods = [state.report.method for state in states]
    assert methods == ["GMRES with p-multigrid", "LU by mumps", "LU by mumps"]
    assert [state.increment for state in states] == [1, 2, 3]
    said = [record.getMessage() for record in caplog.records if record.name == "pw_elements"]
    assert sum(words.startswith(GAVE_UP) for words in said) == 1
    assert [progress.state for progress in told if progress.state] == states
    for state, exact in zip(states, known, strict=True):
        assert difference(state.displacement, exact.displacement) < 1e-9
        assert np.array_equal(state.pairs[0].status, exact.pairs[0].status)
        assert state.pairs[0].force == pytest.approx(exact.pairs[0].force, rel=1e-9, abs=1e-9)


@pytest.mark.usefixtures("small")
def test_without_memory_for_factors_the_error_stays(monkeypatch):
    arguments = nearly_sliding(Solid(n=2))
    monkeypatch.setattr(iterative, "free_memory", lambda _: 1e6)
    with pytest.raises(NotConverged, match=r"\"auto\" does not use .* 0\.001 GB left"):
        solve_contact(*arguments)


@pytest.mark.parametrize("solver", ["auto", Iterative()])
@pytest.mark.usefixtures("small")
def test_a_proof_comes_before_other_ways(solver, caplog):
    """Pushed by more than friction bears: Krylov's method fails, and no method would do."""
    K, loads, supports, pair, U = nearly_sliding(Solid(n=2), push=0.8)
    with caplog.at_level(logging.INFO), pytest.raises(NoEquilibrium, match="slides along"):
        solve_contact(K, loads, supports, pair, U, solver=solver)
    assert not any(GAVE_UP in record.getMessage() for record in caplog.records)


@pytest.mark.usefixtures("impatient")
def test_displacements_of_hybrid_bodies_by_factors():
    spaces = Spaces.hybrid(box("tetrahedron"))
    body = Body(spaces, Material(1.0, 0.5), "solid")
    K, f = assemble_matrix(body.stiffness()), assemble_vector(body.body_load((0.0, 0.0, -1.0)))
    held = Reduction.dirichlet(
        spaces.trial, [prescribe(spaces.trial, i, at(0, 0.0)) for i in range(3)]
    )
    a = solve(K, f, held, "auto")
    assert a.getAttr("report").method == "LU by mumps"
    assert difference(a, solve(K, f, held, Direct())) == 0


@pytest.mark.usefixtures("impatient")
def test_modes_by_factors():
    body, K, _, held = case("pw-T10", nu=0.49)
    M = assemble_matrix(body.mass())
    found, known = (vibration_modes(K, M, held, 3, solver=s) for s in (None, Direct()))
    assert found.report == known.report
    assert found.eigenvalues == pytest.approx(known.eigenvalues, rel=1e-10)


@pytest.mark.usefixtures("impatient")
def test_buckling_by_factors():
    body, K, f, held = case("pw-T10")
    displacement = as_function(body.spaces.trial, solve(K, f, held, Direct()))
    K_sigma = assemble_matrix(body.initial_stress(body.stress(displacement)))
    found, known = (buckling(K, K_sigma, held, solver=s) for s in (None, Direct()))
    assert found.report == known.report
    assert found.factors == pytest.approx(known.factors, rel=1e-10)


def test_memory():
    """MUMPS took 6.2 GB for 212 355 unknowns; no more is left than the machine has."""
    assert iterative.memory_of_factors(212_355) == pytest.approx(6.2e9, rel=0.3)
    assert (
        0
        < iterative.free_memory(MPI.COMM_WORLD)
        < os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    )
