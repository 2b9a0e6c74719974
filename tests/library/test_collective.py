"""What fails on one process fails on all of them, with the same words."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest

from pw_elements.checks import answer, collective
from pw_elements.checks.guard import _digest
from pw_elements.contact import Motion, Parabola, Plane, Sphere

PROJECT = Path(__file__).parents[2]

DIFFERS = "this differs between processes 0 and {k}, but all of them have to state the same problem"
FAILED = "failed on process {k}: KeyError: 'x'"
POINTS = r"for \d+ points: it takes points as"
HERE = r"of which process {k} has \d+"

# The words of each scenario in one_process_errs.py, as patterns; k is the process that errs
SAID = {
    "marker of prescribe": f"the marker of the prescribed nodes {FAILED}",
    "marker of prescribe gives one value": "the marker of the prescribed nodes gave bool of the "
    rf"shape \(\) {POINTS} columns \(3, n\) and gives True or False for each, \(n,\)",
    "component": "component 2: the space has 2, counted from 0",
    "component differs": f"the component: {DIFFERS}",
    "value is no number": "the prescribed value = '0': has to be a finite number",
    "marker of boundary_measure": f"the marker of the boundary {FAILED}",
    "marker of the boundary gives one value": "the marker of the boundary gave bool of the shape "
    rf"\(\) {POINTS} columns \(3, n\) and gives True or False for each, \(n,\)",
    "facet number": "facets have the numbers 1000000 to 1000000: local numbers are counted from 0, "
    + HERE,
    "facet type": r"facets are float64 of the shape \(1,\): they are a marker, local numbers "
    rf"\(integers\), or a mask of all of them, {HERE}",
    "facet mask": f"facets are a mask of 3: it is one of all, {HERE}",
    "marker of nodal_load": f"the marker of the loaded nodes {FAILED}",
    "nodal force": r"nodal force \(nan, 0.0\): it needs 2 finite components",
    "nodal force differs": f"the nodal force: {DIFFERS}",
    "mass": "the mass matrix has entries that are not finite",
    "marker of forces_along": f"the marker of the line {FAILED}",
    "marker of surface nodes": f"the marker of the boundary {FAILED}",
    "condition": "a condition is None: `prescribe` makes one",
    "node to be condensed": "the nodes to be condensed have the numbers 1000000 to 1000000: local "
    f"numbers are counted from 0, {HERE}",
    "load of solve": "the load is not finite",
    "image": f"the image of the mesh {FAILED}",
    "image of curved cells": f"the image of the mesh {FAILED}",
    "divisions differ": f"divisions: {DIFFERS}",
    "mesh lines": r"y_lines \[0, nan\]: it needs finite components",
    "marker of a pair": f"the marker of contact pair 0 {FAILED}",
    "nodes of a pair": "the nodes of contact pair 0 have the numbers 1000000 to 1000000: local "
    f"numbers are counted from 0, {HERE}",
    "kind of a pair": "a contact pair is of the type Plane: it has to be a ContactPair",
    "number of pairs": f"the number of contact pairs: {DIFFERS}",
    "friction": f"the friction of contact pair 0 {FAILED}",
    "shape of friction": r"the friction of contact pair 0 gave float64 of the shape \(\d+,\) "
    rf"{POINTS} columns \(3, n\) and gives \(n,\)",
    "friction differs": f"the friction of contact pair 0: {DIFFERS}",
    "gap": f"the gap of the surface of contact pair 0 {FAILED}",
    "normal": r"the normal of the surface of contact pair 0 gave float64 of the shape \(1, 2\) "
    rf"{POINTS} rows \(n, dim\) and gives \(n, dim\)",
    "motions of pairs": f"the motions of contact pair 0: {DIFFERS}",
    "loads": "the load of increment 0 is not finite",
    "kind of loads": "a load is 0.0: it has to be a Vec",
    "number of loads": f"the number of loads: {DIFFERS}",
    "supports": "the reduction is Dirichlet conditions: make one by .*",
    "max_iterations": "max_iterations = 0: has to be a whole number, 1 at least",
    "max_iterations differ": f"max_iterations: {DIFFERS}",
    "stiffness": "the stiffness has entries that are not finite",
    "start": "a state to start from is 0: it has to be a ContactState",
    "motions of a step": "2 motions for 1 contact pairs",
    "motions of a step differ": f"the motions: {DIFFERS}",
    "state of a step": "the state belongs to other contact nodes than this problem's",
    "state of a step differs": f"the state: {DIFFERS}",
    "state of a step with NaN": "the state has forces or displacements that are not finite",
    "proof": "singular",
    "search": "singular",
    "load of a residual": f"the load {FAILED}",
    "load of a residual differs": f"the load: {DIFFERS}",
    "solver of a residual": r"the solver is 3: give a LinearSolver such as Direct\(\) or .*",
    "file": r"the state cannot be written to /nowhere/.*: \[Errno 2\] No such file or directory: "
    "'/nowhere/.*'",
    "path of a surface": f"the path of contact pair 0 {FAILED}",
    "paths differ": f"the paths: {DIFFERS}",
    "load in time": "the load at the time 0 is not finite",
    "duration differs": f"the duration: {DIFFERS}",
}


KINDS = {
    "file": "FileNotFoundError",
    "proof": "LinAlgError",
    "search": "LinAlgError",
} | dict.fromkeys(
    ["condition", "kind of a pair", "solver of a residual", "kind of loads", "supports", "start"],
    "TypeError",
)


@pytest.mark.skipif(shutil.which("mpirun") is None, reason="no mpirun")
@pytest.mark.parametrize("processes", [2, 3])
def test_an_error_on_one_process_ends_all_with_the_same_words(processes):
    command = [
        "mpirun",
        "-n",
        str(processes),
        sys.executable,
        "-m",
        "tests.library.one_process_errs",
    ]
    quiet = os.environ | {"OMPI_MCA_mpi_yield_when_idle": "1"}
    run = subprocess.run(
        command, cwd=PROJECT, env=quiet, capture_output=True, text=True, timeout=1800
    )
    assert run.returncode == 0, run.stderr
    outcome = json.loads(run.stdout)
    assert outcome["said"].keys() == SAID.keys()
    for name, said in outcome["said"].items():
        assert len(said) == processes
        assert len(set(said)) == 1, name
        words = SAID[name].replace("{k}", str(outcome["wrong"]))
        kind = KINDS.get(name, "ValueError")
        assert re.fullmatch(f"{kind}: {words}", said[0]), name


def test_errors_of_users_functions_are_the_cause_of_the_librarys():
    comm = MPI.COMM_SELF
    words = r"^the marker failed: KeyError: 'x'$"
    with pytest.raises(ValueError, match=words) as caught, collective(comm):
        answer(comm, "the marker", {}.__getitem__, "x")
    assert isinstance(caught.value.__cause__, KeyError)


@pytest.mark.parametrize(
    ("one", "other", "alike"),
    [
        (0.0, -0.0, True),
        (1, 1.0, True),
        (0.3, np.nextafter(0.3, 1), False),
        (np.nan, np.nan, True),
        ("triangle", "quadrilateral", False),
        (Motion((0, None), (0, -1.0)), Motion((0.0, None), (0.0, -1.0)), True),
        (Motion((0, None), (0, -1.0)), Motion((0, None), (0, -2.0)), False),
        (Motion((0, None)), Motion((None, 0)), False),
        ([Motion((0, 0))], [], False),
        (Plane((0, 0), (0, 1)), Plane((0, 0), (1, 0)), False),
        (Sphere((0, 0), 1.0), Parabola((0, 0), 1.0), False),
        (np.zeros((2, 3)), np.zeros((3, 2)), False),
        (np.array([None, 1.0]), np.array([None, 2.0]), False),
        (abs, len, True),  # functions cannot be compared
    ],
)
def test_what_counts_as_different(one, other, alike):
    assert (_digest(one) == _digest(other)) == alike
