"""Gmsh's mesh files by hand: meshes stated in Python, files written from them, and read again.

Writer and reader follow the "Gmsh Reference Manual", version 4.13, number by number, and share no
code with the library. The reader takes what it is given: files that lie are for the library.
"""

import re
import struct
from dataclasses import dataclass, field
from itertools import product

import numpy as np

# Corners of each edge and face, in the order in which their middle nodes follow the corners
EDGES = {
    "triangle": [(0, 1), (1, 2), (2, 0)],
    "quadrilateral": [(0, 1), (1, 2), (2, 3), (3, 0)],
    "tetrahedron": [(0, 1), (1, 2), (2, 0), (3, 0), (3, 2), (3, 1)],
    "hexahedron": [
        *((0, 1), (0, 3), (0, 4), (1, 2), (1, 5), (2, 3)),
        *((2, 6), (3, 7), (4, 5), (4, 7), (5, 6), (6, 7)),
    ],
}
FACES = {
    "tetrahedron": [(0, 2, 1), (0, 1, 3), (0, 3, 2), (3, 1, 2)],
    "hexahedron": [
        *((0, 3, 2, 1), (0, 1, 5, 4), (0, 4, 7, 3)),
        *((1, 2, 6, 5), (2, 3, 7, 6), (4, 5, 6, 7)),
    ],
}
# Types by Gmsh's numbers: of each cell those of degree 1 and 2, nodes, dimension, and corners
CELLS = {"triangle": (2, 9), "quadrilateral": (3, 10), "tetrahedron": (4, 11)}
CELLS["hexahedron"] = (5, 12)
N_NODES = {15: 1, 1: 2, 8: 3, 2: 3, 9: 6, 3: 4, 10: 9, 4: 4, 11: 10, 5: 8, 12: 27, 21: 10, 6: 6}
N_NODES |= {16: 8, 26: 4}
DIM = {15: 0, 1: 1, 8: 1, 26: 1, 2: 2, 9: 2, 3: 2, 10: 2, 21: 2, 16: 2, 4: 3, 11: 3, 5: 3, 12: 3}
DIM |= {6: 3}
N_CORNERS = {1: 2, 8: 2, 2: 3, 9: 3, 3: 4, 10: 4, 4: 4, 11: 4, 5: 8, 12: 8}
FORMATS = ("2.2", "2.2 binary", "4.0", "4.0 binary", "4.1", "4.1 binary")
RARE_FORMATS = ("2", "2.2 binary >", "4.1 binary >", "4.1 binary 4")


@dataclass
class Block:
    """Elements [number, node, node, ...] of one type on an entity, which is in groups."""

    kind: int
    entity: int
    groups: tuple[int, ...]
    elements: list[list[int]]
    dim: int = -1

    def __post_init__(self):
        self.dim = DIM[self.kind]


@dataclass
class Stated:
    """Nodes [number, x, y, z], blocks of elements, and names of (dimension, group)."""

    nodes: list[list[float]]
    blocks: list[Block]
    names: dict[tuple[int, int], str] = field(default_factory=dict)


def lattice(cell, degree, divisions=2, seed=0):
    """Return a square or cube of cells: two groups of cells, one of facets, all with odd numbers.

    Nodes are moved at random, so that no two places are alike.
    """
    rng = np.random.default_rng(seed)
    dim = 2 if cell in ("triangle", "quadrilateral") else 3
    shape = (2 * divisions + 1,) * dim
    points = [p + (0,) * (3 - dim) for p in product(*map(range, shape))]
    numbers = rng.choice(np.arange(1, 5 * len(points)), len(points), replace=False).tolist()
    number = dict(zip(points, numbers, strict=True))
    moves = 0.02 * rng.random((len(points), 3))
    x = dict(zip(points, (np.array(points) / (2 * divisions) + moves).tolist(), strict=True))
    if dim == 2:
        for place in x.values():
            place[2] = 0.25
    blocks = []
    kind = CELLS[cell][degree - 1]
    cells = [row for square in product(range(divisions), repeat=dim) for row in _cut(cell, square)]
    half = len(cells) // 2
    for entity, (groups, some) in enumerate([((3,), cells[:half]), ((7,), cells[half:])], 1):
        rows = [[0, *(number[p] for p in _with_middles(cell, degree, row))] for row in some]
        blocks.append(Block(kind, entity, groups, rows))
    sides = {2: EDGES, 3: FACES}[dim][cell]
    facets = [[row[k] for k in side] for row in cells for side in sides]
    facets = [facet for facet in facets if all(p[0] == 0 for p in facet)]
    face = {2: "line", 3: "triangle" if cell == "tetrahedron" else "quadrilateral"}[dim]
    kind = ({"line": (1, 8)} | CELLS)[face][degree - 1]
    rows = [[0, *(number[p] for p in _with_middles(face, degree, row))] for row in facets]
    blocks.append(Block(kind, 5, (3,), rows))
    for label, row in enumerate((row for block in blocks for row in block.elements), 11):
        row[0] = label
    used = {node for block in blocks for row in block.elements for node in row[1:]}
    nodes = [[number[p], *x[p]] for p in rng.permutation(points).tolist() for p in [tuple(p)]]
    nodes = [node for node in nodes if node[0] in used]
    return Stated(nodes, blocks, {(dim, 3): "Körper", (dim - 1, 3): "left side"})


def _cut(cell, square):
    """Give the cells of a square or cube of the lattice, by their corners."""
    at = np.array([*square, 0][:3]) * 2
    quad = [tuple(at + 2 * np.array(c)) for c in ((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0))]
    quad = [tuple(map(int, p)) for p in quad]
    brick = quad + [(p[0], p[1], p[2] + 2) for p in quad]
    a, b, c, d, *_, g, _ = brick
    if cell == "quadrilateral":
        yield quad
    elif cell == "triangle":
        yield from ([a, b, c], [a, c, d])
    elif cell == "hexahedron":
        yield brick
    else:  # round the diagonal from the first corner to the opposite one
        ring = [brick[k] for k in (1, 2, 3, 7, 4, 5)]
        for p, q in zip(ring, ring[1:] + ring[:1], strict=True):
            yield [a, p, q, g]


def _with_middles(cell, degree, corners):
    if degree == 1:
        return corners
    edges = ({"line": [(0, 1)]} | EDGES)[cell]
    parts = [*edges, *(FACES[cell] if cell == "hexahedron" else [])]
    parts += [tuple(range(len(corners)))] if cell in ("quadrilateral", "hexahedron") else []
    middles = [np.mean([corners[k] for k in part], axis=0) for part in parts]
    return [*corners, *(tuple(map(int, middle)) for middle in middles)]


def write(stated, form, counts=(), entities=None):
    """Return the file of a mesh; `counts` states other numbers than are there.

    Args:
        stated: the mesh.
        form: version, " binary" or not, " >" for the other order of bytes, " 4" for short counts.
        counts: of "nodes", "elements" (in all), "node block", "element block", "names".
        entities: groups of (dimension, entity), in place of those of the blocks.
    """
    version, *words = form.split()
    counts, binary = dict(counts), "binary" in words
    order, size = (">" if ">" in words else "<"), ("i" if "4" in words else "q")

    def row(letters, *values):
        if not binary:
            return " ".join(map(_word, values)) + "\n"
        return struct.pack(order + letters.replace("q", size), *values).decode("latin-1")

    text = f"$MeshFormat\n{version} {int(binary)} {'4' if size == 'i' else '8'}\n"
    text += row("i", 1) + "\n" if binary else ""
    text += "$EndMeshFormat\n"
    if stated.names:
        text += f"$PhysicalNames\n{counts.get('names', len(stated.names))}\n"
        for (dim, group), name in stated.names.items():
            text += f'{dim} {group} "{name.encode().decode("latin-1")}"\n'
        text += "$EndPhysicalNames\n"
    n_nodes, n_blocks = len(stated.nodes), len(stated.blocks)
    rows = [(block, element) for block in stated.blocks for element in block.elements]
    if version[0] == "2":
        text += f"$Nodes\n{counts.get('nodes', n_nodes)}\n"
        text += "".join(row("iddd", *node) for node in stated.nodes)
        rows = [(block, *r) for block, r in rows for block in _once_per_group(block)]
        text += f"\n$EndNodes\n$Elements\n{counts.get('elements', len(rows))}\n"
        several = any(len(block.groups) > 1 for block in stated.blocks)
        for k, (block, label, *nodes) in enumerate(rows):
            tags = (block.groups or (0,))[0], block.entity
            head = (block.kind, 1, 2) if binary else ()
            label = k + 1 if several else label
            between = () if binary else (block.kind, 2)
            values = (*head, label, *between, *tags, *nodes)
            text += row("i" * len(values), *values)
        return (text + "\n$EndElements\n").encode("latin-1")
    new = version == "4.1"
    if entities is None:
        entities = {(block.dim, block.entity): block.groups for block in stated.blocks}
    of_dim = [[key for key in entities if key[0] == dim] for dim in range(4)]
    text += "$Entities\n" + row("qqqq", *map(len, of_dim))
    for dim, entity in [key for keys in of_dim for key in keys]:
        groups, box = entities[dim, entity], [0.0] * (3 if dim == 0 and new else 6)
        bounds = (0,) if dim else ()
        letters = "i" + "d" * len(box) + "q" + "i" * len(groups) + "q" * len(bounds)
        text += row(letters, entity, *box, len(groups), *groups, *bounds)
    text += "\n$EndEntities\n$Nodes\n"
    n_nodes, half = counts.get("nodes", n_nodes), n_nodes // 2
    extremes = (1, max((int(abs(node[0])) for node in stated.nodes), default=0) + 1) if new else ()
    text += row("qq" + "q" * len(extremes), 2, n_nodes, *extremes)
    for some in (stated.nodes[:half], stated.nodes[half:]):
        count = counts.get("node block", len(some))
        entity = (stated.blocks[0].dim, stated.blocks[0].entity)
        text += row("iiiq", *(entity if new else entity[::-1]), 0, count)
        if new:
            text += "".join(row("q", node[0]) for node in some)
            text += "".join(row("ddd", *node[1:]) for node in some)
        else:
            text += "".join(row("iddd", *node) for node in some)
    text += "\n$EndNodes\n$Elements\n"
    text += row("qq" + "q" * len(extremes), n_blocks, counts.get("elements", len(rows)), *extremes)
    for block in stated.blocks:
        entity = (block.dim, block.entity)
        count = counts.get("element block", len(block.elements))
        text += row("iiiq", *(entity if new else entity[::-1]), block.kind, count)
        letter = "q" if new else "i"
        text += "".join(row(letter * len(element), *element) for element in block.elements)
    return (text + "\n$EndElements\n").encode("latin-1")


def _once_per_group(block):
    if len(block.groups) < 2:
        return [block]
    return [Block(block.kind, block.entity, (group,), []) for group in block.groups]


def _word(value):
    return repr(float(value)) if isinstance(value, float) else str(value)


class _Source:
    """Numbers of a section one after the other, as text or in binary."""

    def __init__(self, data, binary, order, size):
        self.data, self.binary, self.order, self.size, self.at = data, binary, order, size, 0
        self.words = iter(() if binary else data.split())

    def take(self, letters):
        if not self.binary:
            return [float(next(self.words)) if c == "d" else int(next(self.words)) for c in letters]
        layout = self.order + letters.replace("q", self.size)
        values = struct.unpack_from(layout, self.data, self.at)
        self.at += struct.calcsize(layout)
        return list(values)

    def line(self):
        if not self.binary:
            return int(next(self.words))
        end = self.data.index(b"\n", self.at)
        value, self.at = int(self.data[self.at : end]), end + 1
        return value


def read(data):
    """Return a mesh as it stands in a file."""
    sections = {}
    for match in re.finditer(rb"\$(\w+)[ \t]*\r?\n(.*?)\$End\1", data, re.DOTALL):
        sections.setdefault(match[1].decode(), match[2])
    head, _, rest = sections["MeshFormat"].partition(b"\n")
    version, binary, size = head.decode().split()
    order = "<" if binary == "0" or rest[:4] == b"\1\0\0\0" else ">"

    def source(name):
        letter = "i" if size == "4" else "q"
        return _Source(sections[name], binary == "1", order, letter)

    names = {}
    for line in sections.get("PhysicalNames", b"").split(b"\n")[1:]:
        if line.strip():
            try:
                text = line.decode()
            except UnicodeDecodeError:
                text = line.decode("latin-1")
            dim, group, name = text.split(None, 2)
            names[int(dim), int(group)] = name.strip()[1:-1]
    nodes, blocks = [], []
    if version[0] == "2":
        of_nodes, of_elements = source("Nodes"), source("Elements")
        nodes = [of_nodes.take("iddd") for _ in range(of_nodes.line())]
        left = of_elements.line()
        while left > 0:
            if binary == "1":
                kind, count, n_tags = of_elements.take("iii")
            else:
                label, kind, n_tags = of_elements.take("iii")
                count = 1
            for _ in range(count):
                label = of_elements.take("i")[0] if binary == "1" else label
                tags = of_elements.take("i" * n_tags)
                group = abs(tags[0]) if tags else 0
                row = [label, *of_elements.take("i" * N_NODES[kind])]
                blocks.append(Block(kind, 0, (group,) if group else (), [row]))
            left -= count
        return Stated(nodes, blocks, names)
    new, groups_of = version == "4.1", {}
    if "Entities" in sections:
        of_entities = source("Entities")
        for dim, count in enumerate(of_entities.take("qqqq")):
            for _ in range(count):
                (entity,) = of_entities.take("i")
                of_entities.take("d" * (3 if new and dim == 0 else 6))
                groups = of_entities.take("i" * of_entities.take("q")[0])
                if dim:
                    of_entities.take("i" * of_entities.take("q")[0])
                groups_of[dim, entity] = tuple({abs(group) for group in groups})
    of_nodes, of_elements = source("Nodes"), source("Elements")
    for _ in range(of_nodes.take("qqqq" if new else "qq")[0]):
        a, b, parametric, count = of_nodes.take("iiiq")
        more = "d" * ((a if new else b) * parametric)
        if new:
            labels = [of_nodes.take("q")[0] for _ in range(count)]
            nodes += [[label, *of_nodes.take("ddd" + more)[:3]] for label in labels]
        else:
            nodes += [of_nodes.take("iddd" + more)[:4] for _ in range(count)]
    for _ in range(of_elements.take("qqqq" if new else "qq")[0]):
        a, b, kind, count = of_elements.take("iiiq")
        entity = (a, b) if new else (b, a)
        letters = ("q" if new else "i") * (1 + N_NODES[kind])
        rows = [of_elements.take(letters) for _ in range(count)]
        blocks.append(Block(kind, entity[1], groups_of.get(entity, ()), rows))
    return Stated(nodes, blocks, names)
