"""Abaqus input files (decks) of all supported element types, each in a different notation.

`DECKS_BY_ELEMENT_TYPE` maps element types such as "C3D20R" to the text of a deck up to *STEP. The
meshes are smoothly distorted lattices, so edges of second-order elements are curved.
"""

from itertools import combinations, permutations, product

import numpy as np

# Corners of the cells on a lattice with steps of two; mid-side nodes have odd coordinates
LATTICE_CORNERS_OF_QUADS_IN_SQUARE = [[(0, 0), (2, 0), (2, 2), (0, 2)]]
LATTICE_CORNERS_OF_TRIANGLES_IN_SQUARE = [[(0, 0), (2, 0), (2, 2)], [(0, 0), (2, 2), (0, 2)]]
LATTICE_CORNERS_OF_BRICKS_IN_CUBE = [
    [(*at, z) for z in (0, 2) for at in LATTICE_CORNERS_OF_QUADS_IN_SQUARE[0]]
]
# six tetrahedra with positive volume, each along a path of edges between opposite brick corners
LATTICE_CORNERS_OF_TETRAHEDRA_IN_CUBE = []
for axes in permutations(range(3)):
    path = [tuple(2 * (axis in axes[:k]) for axis in range(3)) for k in range(4)]
    odd = sum(a > b for a, b in combinations(axes, 2)) % 2
    LATTICE_CORNERS_OF_TETRAHEDRA_IN_CUBE.append(
        [path[k] for k in ((0, 1, 3, 2) if odd else (0, 1, 2, 3))]
    )
EDGES_BY_CORNER_COUNT = {
    3: [(0, 1), (1, 2), (2, 0)],
    4: [(0, 1), (1, 2), (2, 3), (3, 0)],
    8: [*zip(range(4), (1, 2, 3, 0), strict=True)],
}
EDGES_BY_CORNER_COUNT[8] += [(a + 4, b + 4) for a, b in EDGES_BY_CORNER_COUNT[8]] + [
    (k, k + 4) for k in range(4)
]
TETRAHEDRON_EDGES = [(0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)]

PLANE_ELEMENT_FAMILIES = ("CPS", "CPE", "CAX", "S", "M3D")
ABAQUS_ELEMENT_TYPES = [
    f"{family}{nodes}" for family in PLANE_ELEMENT_FAMILIES for nodes in (3, 4, 6, 8)
]
ABAQUS_ELEMENT_TYPES += [
    "CPS4R",
    "CPE4R",
    "CAX8R",
    "CPS8R",
    "CPE8R",
    "S8R",
    "S4R",
    "M3D8R",
    "C3D4",
    "C3D8",
]
ABAQUS_ELEMENT_TYPES += ["C3D8R", "C3D8I", "C3D10", "C3D10T", "C3D20", "C3D20R"]


def count_nodes(element_type):
    """Return the number of nodes of an element type."""
    digits = element_type.removeprefix("C3D").removeprefix("M3D").strip("CPSEAXRIT")
    return int(digits)


def distort_lattice_point(lattice_point, element_type):
    """Return the image (3,) of a lattice point under a smooth map, rounded to six digits."""
    x = np.array([*lattice_point, 0.0])[:3] / 2
    bend = 0.12 if count_nodes(element_type) not in (3, 4) or element_type == "C3D4" else 0.2
    y = x + bend * np.sin(1 + np.array([x[1] + 0.3 * x[2], 0.7 * x[0] + x[2], x[0] - x[1]]))
    y[0] += 1.5
    if not element_type.startswith("C3D"):
        y[2] = 0.0
    return y.round(6)


def make_distorted_lattice_mesh(element_type):
    """Return points (n, 3), cells as lists of indices of points, and the points' lattice points."""
    n_nodes, is_solid = count_nodes(element_type), element_type.startswith("C3D")
    if is_solid:
        pattern = (
            LATTICE_CORNERS_OF_BRICKS_IN_CUBE
            if n_nodes in (8, 20)
            else LATTICE_CORNERS_OF_TETRAHEDRA_IN_CUBE
        )
        corner_edges = EDGES_BY_CORNER_COUNT[8] if n_nodes in (8, 20) else TETRAHEDRON_EDGES
        blocks = product(range(2), range(2), range(2))
    else:
        pattern = (
            LATTICE_CORNERS_OF_TRIANGLES_IN_SQUARE
            if n_nodes in (3, 6)
            else LATTICE_CORNERS_OF_QUADS_IN_SQUARE
        )
        corner_edges = EDGES_BY_CORNER_COUNT[3] if n_nodes in (3, 6) else EDGES_BY_CORNER_COUNT[4]
        blocks = product(range(3), range(2))
    lattice: dict[tuple, int] = {}
    cells = []
    for block in blocks:
        for corners in pattern:
            points = [
                tuple(2 * b + c for b, c in zip(block, corner, strict=True)) for corner in corners
            ]
            if n_nodes > len(points):
                points += [
                    tuple((p + q) // 2 for p, q in zip(points[a], points[b], strict=True))
                    for a, b in corner_edges
                ]
            cells.append([lattice.setdefault(point, len(lattice)) for point in points])
    return [distort_lattice_point(point, element_type) for point in lattice], cells, list(lattice)


def format_in_random_fortran_notation(coordinate, rng):
    """Return a coordinate in a randomly chosen Fortran notation."""
    text = f"{coordinate:.6f}"
    if coordinate == 0:
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


def make_deck_text(element_type):
    """Return the text of a deck with nodes, elements, sets and surfaces, but without materials."""
    rng = np.random.default_rng(sum(map(ord, element_type)) * 131 + len(element_type))
    points, cells, lattice = make_distorted_lattice_mesh(element_type)
    first_number, step = int(rng.integers(1, 90)), int(rng.integers(1, 4))
    node_numbers = rng.permutation(first_number + step * np.arange(len(points)))
    element_numbers = rng.permutation(int(rng.integers(1, 40)) + np.arange(len(cells)))
    case = rng.choice([str.upper, str.lower, str.capitalize])
    lines = [
        "*" + case("heading"),
        " one of many decks",
        "** a comment",
        f"*{case('node')}, NSET=All",
    ]
    for number, point in zip(node_numbers, points, strict=True):
        row = ",".join([str(number), *(format_in_random_fortran_notation(c, rng) for c in point)])
        lines.append(row.rstrip(",") + str(rng.choice(["", ","])))

    # the cells are in two sets
    left_cells = [k for k, cell in enumerate(cells) if lattice[cell[0]][0] == 0]
    for name, members in (
        ("left", left_cells),
        ("Right", [k for k in range(len(cells)) if k not in left_cells]),
    ):
        lines.append(f"*{case('element')} , {case('type')}={element_type.lower()}, ELSET = {name}")
        for k in members:
            row = [str(element_numbers[k]), *(str(node_numbers[n]) for n in cells[k])]
            line_length = 11 if len(row) > 16 else len(row)
            lines.append(", ".join(row[:line_length]) + ("," if len(row) > line_length else ""))
            lines += [" , ".join(row[line_length:])] if len(row) > line_length else []

    # CalculiX calls the edges of shells S3, S4 ...
    face = "S3" if element_type.startswith(("S", "M3D")) else "S2"
    lines += [f"*SURFACE, NAME=front, {case('type=element')}", f"BOTH , {face}"]
    lines += [f"{element_numbers[0]}, {'S5' if face == 'S3' else 'S3'}"]
    bottom = [int(n) for n, point in zip(node_numbers, lattice, strict=True) if point[1] == 0]
    lines += ["*NSET,NSET=bottom"]
    lines += [" ,".join(map(str, bottom[k : k + 7])) for k in range(0, len(bottom), 7)]
    lines += [
        "*nset, nset = Everything, generate",
        f"{node_numbers.min()}, {node_numbers.max()}, {step}",
    ]
    lines += ["*NSET,NSET=BOTTOM", "bottom", f"{int(node_numbers[0])},"]
    smallest, largest = int(element_numbers.min()), int(element_numbers.max())
    lines += [
        "*ELSET,ELSET=some,GENERATE",
        f"{smallest},{(smallest + largest) // 2}",
        f"{largest},{largest},1",
    ]
    lines += ["*ELSET,ELSET=Both", "some, LEFT", str(element_numbers[-1])]
    lines += ["*SURFACE,NAME=base,TYPE=NODE", "bottom"]
    line_end = str(rng.choice(["\n", "\r\n"]))
    return line_end.join(lines) + line_end


DECKS_BY_ELEMENT_TYPE = {kind: make_deck_text(kind) for kind in ABAQUS_ELEMENT_TYPES}
