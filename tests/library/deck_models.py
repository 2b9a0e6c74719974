"""Decks of all types of elements that are read, each written in another way.

`DECK_MODELS` maps element types such as "C3D20R" to the text of a deck up to *STEP. The meshes are
images of a lattice, so that edges of second-order elements are curved.
"""

from itertools import combinations, permutations, product

import numpy as np

# Corners of cells on a lattice of steps of two, the middles of their edges being between
QUAD = [[(0, 0), (2, 0), (2, 2), (0, 2)]]
TRIANGLES = [[(0, 0), (2, 0), (2, 2)], [(0, 0), (2, 2), (0, 2)]]
BRICK = [[(*at, z) for z in (0, 2) for at in QUAD[0]]]
# along its edges from one corner of a brick to the other, corners in the order of positive volume
TETRAHEDRA = []
for axes in permutations(range(3)):
    path = [tuple(2 * (axis in axes[:k]) for axis in range(3)) for k in range(4)]
    odd = sum(a > b for a, b in combinations(axes, 2)) % 2
    TETRAHEDRA.append([path[k] for k in ((0, 1, 3, 2) if odd else (0, 1, 2, 3))])
EDGES = {
    3: [(0, 1), (1, 2), (2, 0)],
    4: [(0, 1), (1, 2), (2, 3), (3, 0)],
    8: [*zip(range(4), (1, 2, 3, 0), strict=True)],
}
EDGES[8] += [(a + 4, b + 4) for a, b in EDGES[8]] + [(k, k + 4) for k in range(4)]
TETRAHEDRON_EDGES = [(0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)]

FLAT = ("CPS", "CPE", "CAX", "S", "M3D")
TYPES = [f"{family}{nodes}" for family in FLAT for nodes in (3, 4, 6, 8)]
TYPES += ["CPS4R", "CPE4R", "CAX8R", "CPS8R", "CPE8R", "S8R", "S4R", "M3D8R", "C3D4", "C3D8"]
TYPES += ["C3D8R", "C3D8I", "C3D10", "C3D10T", "C3D20", "C3D20R"]


def nodes_of(kind):
    """Return the number of nodes of a type."""
    digits = kind.removeprefix("C3D").removeprefix("M3D").strip("CPSEAXRIT")
    return int(digits)


def image(at, kind):
    """Place of a lattice's point (steps of one), distinct in all directions, with few digits."""
    x = np.array([*at, 0.0])[:3] / 2
    bend = 0.12 if nodes_of(kind) not in (3, 4) or kind == "C3D4" else 0.2
    y = x + bend * np.sin(1 + np.array([x[1] + 0.3 * x[2], 0.7 * x[0] + x[2], x[0] - x[1]]))
    y[0] += 1.5
    if not kind.startswith("C3D"):
        y[2] = 0.0
    return y.round(6)


def mesh(kind):
    """Points (n, 3) and cells, as lists of their numbers from 0, and the lattice's points."""
    count, solid = nodes_of(kind), kind.startswith("C3D")
    if solid:
        pattern = BRICK if count in (8, 20) else TETRAHEDRA
        corner_edges = EDGES[8] if count in (8, 20) else TETRAHEDRON_EDGES
        blocks = product(range(2), range(2), range(2))
    else:
        pattern = TRIANGLES if count in (3, 6) else QUAD
        corner_edges = EDGES[3] if count in (3, 6) else EDGES[4]
        blocks = product(range(3), range(2))
    lattice: dict[tuple, int] = {}
    cells = []
    for block in blocks:
        for corners in pattern:
            at = [
                tuple(2 * b + c for b, c in zip(block, corner, strict=True)) for corner in corners
            ]
            if count > len(at):
                at += [
                    tuple((p + q) // 2 for p, q in zip(at[a], at[b], strict=True))
                    for a, b in corner_edges
                ]
            cells.append([lattice.setdefault(point, len(lattice)) for point in at])
    return [image(point, kind) for point in lattice], cells, list(lattice)


def written(value, rng):
    """Return a coordinate in one of the ways in which Fortran's numbers are written."""
    text = f"{value:.6f}"
    if value == 0:
        return str(rng.choice(["", "0.", " 0.0 ", "0.D0", "-0"]))
    ways = [
        text,
        f" {text}",
        f"{text}D0",
        f"{text}d+00",
        f"{text}E0",
        f"+{text}".replace("+-", "-"),
    ]
    return str(rng.choice(ways))


def model(kind):
    """Return the text of a deck: nodes, elements, sets and surfaces, without materials."""
    rng = np.random.default_rng(sum(map(ord, kind)) * 131 + len(kind))
    points, cells, lattice = mesh(kind)
    first, step = int(rng.integers(1, 90)), int(rng.integers(1, 4))
    node = rng.permutation(first + step * np.arange(len(points)))
    element = rng.permutation(int(rng.integers(1, 40)) + np.arange(len(cells)))
    word = rng.choice([str.upper, str.lower, str.capitalize])
    lines = [
        "*" + word("heading"),
        " one of many decks",
        "** a comment",
        f"*{word('node')}, NSET=All",
    ]
    for number, point in zip(node, points, strict=True):
        row = ",".join([str(number), *(written(c, rng) for c in point)])
        lines.append(row.rstrip(",") + str(rng.choice(["", ","])))

    # cells in two sets
    left = [k for k, cell in enumerate(cells) if lattice[cell[0]][0] == 0]
    for name, members in (
        ("left", left),
        ("Right", [k for k in range(len(cells)) if k not in left]),
    ):
        lines.append(f"*{word('element')} , {word('type')}={kind.lower()}, ELSET = {name}")
        for k in members:
            row = [str(element[k]), *(str(node[n]) for n in cells[k])]
            cut = 11 if len(row) > 16 else len(row)
            lines.append(", ".join(row[:cut]) + ("," if len(row) > cut else ""))
            lines += [" , ".join(row[cut:])] if len(row) > cut else []

    # edges of shells are S3, S4 ... in CalculiX
    side = "S3" if kind.startswith(("S", "M3D")) else "S2"
    lines += [f"*SURFACE, NAME=front, {word('type=element')}", f"BOTH , {side}"]
    lines += [f"{element[0]}, {'S5' if side == 'S3' else 'S3'}"]
    bottom = [int(n) for n, at in zip(node, lattice, strict=True) if at[1] == 0]
    lines += ["*NSET,NSET=bottom"]
    lines += [" ,".join(map(str, bottom[k : k + 7])) for k in range(0, len(bottom), 7)]
    lines += ["*nset, nset = Everything, generate", f"{node.min()}, {node.max()}, {step}"]
    lines += ["*NSET,NSET=BOTTOM", "bottom", f"{int(node[0])},"]
    low, high = int(element.min()), int(element.max())
    lines += ["*ELSET,ELSET=some,GENERATE", f"{low},{(low + high) // 2}", f"{high},{high},1"]
    lines += ["*ELSET,ELSET=Both", "some, LEFT", str(element[-1])]
    lines += ["*SURFACE,NAME=base,TYPE=NODE", "bottom"]
    end = str(rng.choice(["\n", "\r\n"]))
    return end.join(lines) + end


DECK_MODELS = {kind: model(kind) for kind in TYPES}
