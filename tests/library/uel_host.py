"""Program that plays the host of user elements: reads a deck, assembles through UEL, and solves.

It knows the user elements only by the arguments of Abaqus' user subroutine UEL. Its solvers are
dense and share no code with the library; nodes and sets are read by the library's reader of decks.
"""

import ctypes
import os
import re
import subprocess
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import scipy.linalg

from pw_elements.abaqus.deck import AbaqusDeck
from pw_elements.abaqus.lines import read_keyword_blocks

STRICT_FLAGS = ("-std=c99", "-O2", "-Wall", "-Wextra", "-Wpedantic", "-Werror")
STATIC, FREQUENCY = 1, 41  # procedures, LFLAGS(1)
FORCE_AND_STIFFNESS, STIFFNESS, MASS, FORCE, PERTURBATION = 1, 2, 4, 5, 100  # LFLAGS(3)


def compile_user_element(element, folder):
    """Compile the C source of a user element, every warning being an error, and load it."""
    source, library = Path(folder) / f"{element.name}.c", Path(folder) / f"{element.name}.so"
    source.write_text(element.c_source)
    compiler = os.environ.get("CC", "gcc").split()
    command = [*compiler, *STRICT_FLAGS, "-shared", "-fPIC", "-o", library, source, "-lm"]
    subprocess.run([str(part) for part in command], check=True)
    return ctypes.CDLL(str(library))


@dataclass(frozen=True)
class ElementAnswer:
    """Arrays that a user element has returned: RHS (columns, dofs), AMATRX (dofs, dofs) ..."""

    force: np.ndarray
    matrix: np.ndarray
    state: np.ndarray
    energy: np.ndarray
    next_increment_ratio: float
    error: int = 0


def call_user_element(
    function,
    coordinates,
    properties,
    displacement=None,
    change=None,
    request=FORCE_AND_STIFFNESS,
    procedure=STATIC,
    is_large=False,
    is_perturbation=False,
    loads=(),
    load_changes=None,
    n_columns=1,
    n_state_variables=24,
    state=None,
    coordinates_per_node=None,
):
    """Call UEL, or the function behind it with a flag of errors, once for one element.

    Args:
        coordinates: coordinates (nodes, dim) of the nodes.
        properties: values of *UEL PROPERTY.
        displacement, change: U and DU (dofs,).
        loads: types and magnitudes of distributed loads; `load_changes` are their increments.
    """
    n_nodes, dim = coordinates.shape
    n_dofs = n_nodes * dim
    stride = coordinates_per_node or dim
    zeros = np.zeros(n_dofs)
    padded = np.zeros((n_nodes, stride))
    padded[:, :dim] = coordinates
    n_rows = n_dofs + 3  # MLVARX may be larger than the number of dofs
    force, matrix = np.full((n_columns, n_rows), np.nan), np.full((n_dofs, n_dofs), np.nan)
    state = np.zeros(n_state_variables) if state is None else state.copy()
    energy, next_ratio = np.zeros(8), np.array([1e36])
    du = np.zeros((n_columns, n_rows))
    du[0, :n_dofs] = zeros if change is None else change
    types = np.array([kind for kind, _ in loads], dtype=np.int32)
    magnitudes = np.array([value for _, value in loads], dtype=float)
    increments = magnitudes if load_changes is None else np.array(load_changes, dtype=float)
    flags = np.array([procedure, is_large, request, is_perturbation, 0, 0, 0], dtype=np.int32)
    error = np.zeros(1, dtype=np.int32)
    arguments = [
        force,
        matrix,
        state,
        energy,
        n_dofs,
        n_columns,
        len(state),
        np.array(properties, dtype=float),
        len(properties),
        padded,
        stride,
        n_nodes,
        zeros if displacement is None else np.array(displacement, dtype=float),
        du,
        zeros,
        zeros,
        1,  # JTYPE
        np.array([1.0, 1.0]),
        np.array([1.0]),
        1,
        1,
        7,  # JELEM
        np.zeros(3),
        len(types),
        types,
        magnitudes,
        np.zeros(2 * n_nodes),
        1,
        flags,
        n_rows,
        increments,
        len(types),
        next_ratio,
        np.zeros(1, dtype=np.int32),
        0,
        np.array([1.0]),
        error,
    ]
    kept = [
        np.array([value], dtype=np.int32) if isinstance(value, int) else value
        for value in arguments
    ]
    function.restype = None
    function(*(ctypes.c_void_p(array.ctypes.data) for array in kept))
    # AMATRX is stored by columns
    return ElementAnswer(
        force[:, :n_dofs], matrix.T, state, energy, float(next_ratio[0]), int(error[0])
    )


class HostProgram:
    """Model of a deck with one type of user elements in the plane.

    Args:
        path: path of the deck. Its user elements have the type U1.
        function: user subroutine UEL.

    Attributes:
        x: coordinates (n, 2) of the nodes.
        node_sets: numbers of the nodes in each set, from 0.
    """

    def __init__(self, path, function):
        self._function = function
        # the reader knows no user elements: it is told that they are continuum elements
        plain = path.with_name("plain.inp")
        text = path.read_text()
        plain.write_text(text.replace("TYPE=U1", "TYPE=CPE6"))
        deck = AbaqusDeck(plain)
        self.x = deck.x[:, :2]
        (table,), (positions,) = deck.nodes, deck.members
        self.elements = np.empty_like(table)
        self.elements[positions] = deck.find_node_indices(table)
        self.node_sets = {name: members for (_, name), members in deck.sets["NSET"].items()}
        element_sets = {name: members for (_, name), members in deck.sets["ELSET"].items()}
        self.loads = [[] for _ in self.elements]
        self._supports, self._forces = {}, np.zeros(self.x.size)
        keywords = {"UELPROPERTY", "USERELEMENT", "BOUNDARY", "DLOAD", "CLOAD"}
        for block in read_keyword_blocks(path, keywords):
            rows = [re.split(r"\s*,\s*", row) for row in block.rows]
            match block.keyword:
                case "USERELEMENT":
                    assert "UNSYMM" in block.parameters
                    self.n_state_variables = int(block.parameters["VARIABLES"])
                case "UELPROPERTY":
                    self.properties = [float(value) for value in rows[0]]
                case "BOUNDARY":
                    for name, first, last, *value in rows:
                        for direction in range(int(first), int(last) + 1):
                            for node in self.node_sets[name]:
                                self._supports[2 * node + direction - 1] = float((*value, 0)[0])
                case "DLOAD":
                    for name, kind, magnitude in rows:
                        for element in element_sets[name]:
                            self.loads[element].append((int(kind[1:]), float(magnitude)))
                case "CLOAD":
                    for name, direction, magnitude in rows:
                        dofs = 2 * self.node_sets[name] + int(direction) - 1
                        self._forces[dofs] += float(magnitude)

    def assemble(self, u=None, **request):
        """Return RHS (n,), with concentrated forces, and AMATRX (n, n) at displacements u (n,)."""
        n = self.x.size
        force, matrix = self._forces.copy(), np.zeros((n, n))
        self.states = []
        for nodes, loads in zip(self.elements, self.loads, strict=True):
            dofs = (2 * nodes[:, None] + [0, 1]).ravel()
            answer = call_user_element(
                self._function,
                self.x[nodes],
                self.properties,
                np.zeros(len(dofs)) if u is None else u[dofs],
                loads=loads,
                n_state_variables=self.n_state_variables,
                **request,
            )
            force[dofs] += answer.force[0]
            matrix[np.ix_(dofs, dofs)] += answer.matrix
            self.states.append(answer.state)
        return force, matrix

    def free_dofs(self):
        return np.setdiff1d(np.arange(self.x.size), list(self._supports))

    def solve_static(self):
        """Return displacements (n,) and reactions (n,) after one iteration of Newton's method."""
        u = np.zeros(self.x.size)
        u[list(self._supports)] = list(self._supports.values())
        residual, K = self.assemble(u)
        free = self.free_dofs()
        u[free] += np.linalg.solve(K[np.ix_(free, free)], residual[free])
        residual, _ = self.assemble(u)
        return u, -residual

    def solve_contact(self, nodes, friction):
        """Press nodes onto a floor y = 0 with Coulomb's law, in one increment from rest.

        Args:
            nodes: nodes of the lower side; all remain in contact.
            friction: coefficient of friction (nodes,).

        Returns:
            Displacements (n,), and normal and tangential forces (nodes,) on the body.
        """
        load, K = self.assemble()
        # 0: the node sticks; -1 or 1: it slips, and the force of friction has this sign
        slip = np.zeros(len(nodes), dtype=int)
        slip[friction == 0] = 1
        along, across = 2 * nodes, 2 * nodes + 1
        for _ in range(100):
            A, f = K.copy(), load.copy()
            for k in range(len(nodes)):
                if slip[k]:  # K u - f = r with r_t = sign mu r_n
                    A[along[k]] -= slip[k] * friction[k] * K[across[k]]
                    f[along[k]] -= slip[k] * friction[k] * load[across[k]]
            held = np.concatenate([across, along[slip == 0]])
            free = np.setdiff1d(np.arange(len(f)), held)
            u = np.zeros(len(f))
            u[free] = np.linalg.solve(A[np.ix_(free, free)], f[free])
            r = K @ u - load
            normal, tangential = r[across], r[along]
            assert normal.min() > 0
            new = slip.copy()
            exceeds = (slip == 0) & (np.abs(tangential) > friction * normal)
            new[exceeds] = np.sign(tangential[exceeds])
            # friction acts against the slip; if it does not, the node sticks
            new[(slip != 0) & (friction > 0) & (u[along] * slip > 0)] = 0
            if np.array_equal(new, slip):
                return u, normal, tangential
            slip = new
        raise AssertionError("the contact iteration has not converged")

    def solve_buckling(self, u, symmetrised=False):
        """Return the lowest positive factor of the load that has caused the displacements u.

        The second value is the relative condition number of the factor: the largest relative change
        of the factor, over that of the matrices.
        """
        _, K = self.assemble(request=STIFFNESS, procedure=FREQUENCY, is_perturbation=True)
        _, prestressed = self.assemble(
            u, request=STIFFNESS, procedure=FREQUENCY, is_perturbation=True, is_large=True
        )
        free = self.free_dofs()
        K, initial = (A[np.ix_(free, free)] for A in (K, prestressed - K))
        if symmetrised:
            K, initial = (K + K.T) / 2, (initial + initial.T) / 2
        reciprocals, left, right = scipy.linalg.eig(-initial, K, left=True)
        largest = np.argmax(reciprocals.real)
        y, x = left[:, largest].real, right[:, largest].real
        factor = -(y @ K @ x) / (y @ initial @ x)  # errors of the vectors cancel to first order
        sizes = np.linalg.norm(K, 2) + factor * np.linalg.norm(initial, 2)
        return factor, np.linalg.norm(y) * np.linalg.norm(x) * sizes / abs(y @ K @ x)


def write_deck(path, x, cells, properties, element_sets, node_sets, history):
    """Write a deck of user elements U1 with 6 nodes.

    Args:
        x: coordinates (n, 2) of the nodes.
        cells: nodes (m, 6) of the elements in Abaqus' order, from 0.
        properties: values of *UEL PROPERTY.
        element_sets, node_sets: members from 0.
        history: text from *BOUNDARY on.
    """
    lines = ["*NODE"]
    lines += [f"{k + 1}, {px!r}, {py!r}" for k, (px, py) in enumerate(x.tolist())]
    lines += ["*USER ELEMENT, TYPE=U1, NODES=6, COORDINATES=2, PROPERTIES=4, VARIABLES=16, UNSYMM"]
    lines += ["1, 2", "*ELEMENT, TYPE=U1, ELSET=BODY"]
    lines += [", ".join(map(str, [k + 1, *(nodes + 1)])) for k, nodes in enumerate(cells)]
    for kind, sets in (("ELSET", element_sets), ("NSET", node_sets)):
        for name, members in sets.items():
            lines += [f"*{kind}, {kind}={name}", *(str(k + 1) for k in members)]
    lines += ["*UEL PROPERTY, ELSET=BODY", ", ".join(map(repr, properties)), history]
    path.write_text("\n".join(lines) + "\n")
