"""Independent writer and reader of Gmsh's mesh files, and small meshes to write.

Writer and reader follow the "Gmsh Reference Manual", version 4.13, and share no code with the
library. The reader does not check its input.
"""

import re
import struct
from dataclasses import dataclass, field
from itertools import product

import numpy as np

# Corners of edges and faces, in the order of the middle nodes of these edges and faces
EDGE_CORNERS_IN_GMSH_ORDER = {
    "triangle": [(0, 1), (1, 2), (2, 0)],
    "quadrilateral": [(0, 1), (1, 2), (2, 3), (3, 0)],
    "tetrahedron": [(0, 1), (1, 2), (2, 0), (3, 0), (3, 2), (3, 1)],
    "hexahedron": [
        *((0, 1), (0, 3), (0, 4), (1, 2), (1, 5), (2, 3)),
        *((2, 6), (3, 7), (4, 5), (4, 7), (5, 6), (6, 7)),
    ],
}
FACE_CORNERS_IN_GMSH_ORDER = {
    "tetrahedron": [(0, 2, 1), (0, 1, 3), (0, 3, 2), (3, 1, 2)],
    "hexahedron": [
        *((0, 3, 2, 1), (0, 1, 5, 4), (0, 4, 7, 3)),
        *((1, 2, 6, 5), (2, 3, 7, 6), (4, 5, 6, 7)),
    ],
}
# Gmsh's type numbers for degrees 1 and 2 by cell; then numbers of nodes, dimensions and numbers of
# corners by type number
GMSH_TYPES_BY_CELL_AND_DEGREE = {
    "triangle": (2, 9),
    "quadrilateral": (3, 10),
    "tetrahedron": (4, 11),
}
GMSH_TYPES_BY_CELL_AND_DEGREE["hexahedron"] = (5, 12)
N_NODES_BY_GMSH_TYPE = {
    15: 1,
    1: 2,
    8: 3,
    2: 3,
    9: 6,
    3: 4,
    10: 9,
    4: 4,
    11: 10,
    5: 8,
    12: 27,
    21: 10,
    6: 6,
}
N_NODES_BY_GMSH_TYPE |= {16: 8, 26: 4}
DIMENSION_BY_GMSH_TYPE = {
    15: 0,
    1: 1,
    8: 1,
    26: 1,
    2: 2,
    9: 2,
    3: 2,
    10: 2,
    21: 2,
    16: 2,
    4: 3,
    11: 3,
    5: 3,
    12: 3,
}
DIMENSION_BY_GMSH_TYPE |= {6: 3}
N_CORNERS_BY_GMSH_TYPE = {1: 2, 8: 2, 2: 3, 9: 3, 3: 4, 10: 4, 4: 4, 11: 4, 5: 8, 12: 8}
COMMON_MSH_FORMATS = ("2.2", "2.2 binary", "4.0", "4.0 binary", "4.1", "4.1 binary")
RARE_MSH_FORMATS = ("2", "2.2 binary >", "4.1 binary >", "4.1 binary 4")


@dataclass
class ElementBlock:
    """Elements [number, node, node, ...] of one type on one entity, and the entity's groups."""

    kind: int
    entity: int
    groups: tuple[int, ...]
    elements: list[list[int]]
    dim: int = -1

    def __post_init__(self):
        self.dim = DIMENSION_BY_GMSH_TYPE[self.kind]


@dataclass
class MshFileContent:
    """Content of a mesh file: nodes [number, x, y, z], blocks, and names by (dimension, group)."""

    nodes: list[list[float]]
    blocks: list[ElementBlock]
    names: dict[tuple[int, int], str] = field(default_factory=dict)


def make_grouped_lattice_mesh(cell, degree, divisions=2, seed=0):
    """Return the mesh of a square or cube with two groups of cells and a group of facets at x = 0.

    Nodes have random numbers. Random displacements make all coordinates distinct.
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
        for position in x.values():
            position[2] = 0.25
    blocks = []
    type_number = GMSH_TYPES_BY_CELL_AND_DEGREE[cell][degree - 1]
    cells = [
        row
        for square in product(range(divisions), repeat=dim)
        for row in _yield_cell_corners_in_lattice_square(cell, square)
    ]
    half = len(cells) // 2
    for entity, (groups, cells_of_group) in enumerate(
        [((3,), cells[:half]), ((7,), cells[half:])], 1
    ):
        element_rows = [
            [0, *(number[p] for p in _add_middle_nodes(cell, degree, row))]
            for row in cells_of_group
        ]
        blocks.append(ElementBlock(type_number, entity, groups, element_rows))
    sides = {2: EDGE_CORNERS_IN_GMSH_ORDER, 3: FACE_CORNERS_IN_GMSH_ORDER}[dim][cell]
    facets = [[row[k] for k in side] for row in cells for side in sides]
    facets = [facet for facet in facets if all(p[0] == 0 for p in facet)]
    face = {2: "line", 3: "triangle" if cell == "tetrahedron" else "quadrilateral"}[dim]
    type_number = ({"line": (1, 8)} | GMSH_TYPES_BY_CELL_AND_DEGREE)[face][degree - 1]
    element_rows = [
        [0, *(number[p] for p in _add_middle_nodes(face, degree, row))] for row in facets
    ]
    blocks.append(ElementBlock(type_number, 5, (3,), element_rows))
    for element_number, row in enumerate((row for block in blocks for row in block.elements), 11):
        row[0] = element_number
    used = {node for block in blocks for row in block.elements for node in row[1:]}
    nodes = [[number[p], *x[p]] for p in rng.permutation(points).tolist() for p in [tuple(p)]]
    nodes = [node for node in nodes if node[0] in used]
    return MshFileContent(nodes, blocks, {(dim, 3): "Körper", (dim - 1, 3): "left side"})


def _yield_cell_corners_in_lattice_square(cell, lattice_square):
    """Yield, for each cell in a square or cube of the lattice, the list of its corners."""
    origin = np.array([*lattice_square, 0][:3]) * 2
    quad = [tuple(origin + 2 * np.array(c)) for c in ((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0))]
    quad = [tuple(map(int, p)) for p in quad]
    brick = quad + [(p[0], p[1], p[2] + 2) for p in quad]
    a, b, c, d, *_, g, _ = brick
    if cell == "quadrilateral":
        yield quad
    elif cell == "triangle":
        yield from ([a, b, c], [a, c, d])
    elif cell == "hexahedron":
        yield brick
    else:  # six tetrahedra around a diagonal of the cube
        ring = [brick[k] for k in (1, 2, 3, 7, 4, 5)]
        for p, q in zip(ring, ring[1:] + ring[:1], strict=True):
            yield [a, p, q, g]


def _add_middle_nodes(cell, degree, corners):
    if degree == 1:
        return corners
    edges = ({"line": [(0, 1)]} | EDGE_CORNERS_IN_GMSH_ORDER)[cell]
    entities = [*edges, *(FACE_CORNERS_IN_GMSH_ORDER[cell] if cell == "hexahedron" else [])]
    entities += [tuple(range(len(corners)))] if cell in ("quadrilateral", "hexahedron") else []
    middles = [np.mean([corners[k] for k in entity], axis=0) for entity in entities]
    return [*corners, *(tuple(map(int, middle)) for middle in middles)]


def encode_msh(mesh_data, file_format, false_counts=(), groups_by_entity=None):
    """Return the content of a mesh file, optionally with false counts.

    Args:
        mesh_data: nodes, blocks and group names of the mesh.
        file_format: version, then optionally " binary", " >" (big-endian) and " 4" (short counts).
        false_counts: counts that replace the correct ones, by "nodes", "elements" (all),
            "node block", "element block" or "names".
        groups_by_entity: groups by (dimension, entity), which replace those of the blocks.
    """
    version, *words = file_format.split()
    false_counts, binary = dict(false_counts), "binary" in words
    order, count_letter = (">" if ">" in words else "<"), ("i" if "4" in words else "q")

    def encode_row(struct_letters, *values):
        if not binary:
            return " ".join(map(_format_number, values)) + "\n"
        return struct.pack(order + struct_letters.replace("q", count_letter), *values).decode(
            "latin-1"
        )

    text = f"$MeshFormat\n{version} {int(binary)} {'4' if count_letter == 'i' else '8'}\n"
    text += encode_row("i", 1) + "\n" if binary else ""
    text += "$EndMeshFormat\n"
    if mesh_data.names:
        text += f"$PhysicalNames\n{false_counts.get('names', len(mesh_data.names))}\n"
        for (dim, group), name in mesh_data.names.items():
            text += f'{dim} {group} "{name.encode().decode("latin-1")}"\n'
        text += "$EndPhysicalNames\n"
    n_nodes, n_blocks = len(mesh_data.nodes), len(mesh_data.blocks)
    rows = [(block, element) for block in mesh_data.blocks for element in block.elements]
    if version[0] == "2":
        text += f"$Nodes\n{false_counts.get('nodes', n_nodes)}\n"
        text += "".join(encode_row("iddd", *node) for node in mesh_data.nodes)
        rows = [(block, *r) for block, r in rows for block in _make_empty_block_per_group(block)]
        text += f"\n$EndNodes\n$Elements\n{false_counts.get('elements', len(rows))}\n"
        is_repeated = any(len(block.groups) > 1 for block in mesh_data.blocks)
        for k, (block, element_number, *nodes) in enumerate(rows):
            tags = (block.groups or (0,))[0], block.entity
            block_header = (block.kind, 1, 2) if binary else ()
            element_number = k + 1 if is_repeated else element_number
            type_and_tag_count = () if binary else (block.kind, 2)
            values = (*block_header, element_number, *type_and_tag_count, *tags, *nodes)
            text += encode_row("i" * len(values), *values)
        return (text + "\n$EndElements\n").encode("latin-1")
    is_4_1 = version == "4.1"
    if groups_by_entity is None:
        groups_by_entity = {(block.dim, block.entity): block.groups for block in mesh_data.blocks}
    entities_by_dim = [[key for key in groups_by_entity if key[0] == dim] for dim in range(4)]
    text += "$Entities\n" + encode_row("qqqq", *map(len, entities_by_dim))
    for dim, entity in [key for keys in entities_by_dim for key in keys]:
        groups, box = groups_by_entity[dim, entity], [0.0] * (3 if dim == 0 and is_4_1 else 6)
        bounding_entities = (0,) if dim else ()
        letters = "i" + "d" * len(box) + "q" + "i" * len(groups) + "q" * len(bounding_entities)
        text += encode_row(letters, entity, *box, len(groups), *groups, *bounding_entities)
    text += "\n$EndEntities\n$Nodes\n"
    n_nodes, n_half = false_counts.get("nodes", n_nodes), n_nodes // 2
    extremes = (
        (1, max((int(abs(node[0])) for node in mesh_data.nodes), default=0) + 1) if is_4_1 else ()
    )
    text += encode_row("qq" + "q" * len(extremes), 2, n_nodes, *extremes)
    for node_block in (mesh_data.nodes[:n_half], mesh_data.nodes[n_half:]):
        count = false_counts.get("node block", len(node_block))
        entity = (mesh_data.blocks[0].dim, mesh_data.blocks[0].entity)
        text += encode_row("iiiq", *(entity if is_4_1 else entity[::-1]), 0, count)
        if is_4_1:
            text += "".join(encode_row("q", node[0]) for node in node_block)
            text += "".join(encode_row("ddd", *node[1:]) for node in node_block)
        else:
            text += "".join(encode_row("iddd", *node) for node in node_block)
    text += "\n$EndNodes\n$Elements\n"
    text += encode_row(
        "qq" + "q" * len(extremes), n_blocks, false_counts.get("elements", len(rows)), *extremes
    )
    for block in mesh_data.blocks:
        entity = (block.dim, block.entity)
        count = false_counts.get("element block", len(block.elements))
        text += encode_row("iiiq", *(entity if is_4_1 else entity[::-1]), block.kind, count)
        letter = "q" if is_4_1 else "i"
        text += "".join(encode_row(letter * len(element), *element) for element in block.elements)
    return (text + "\n$EndElements\n").encode("latin-1")


def _make_empty_block_per_group(block):
    if len(block.groups) < 2:
        return [block]
    return [ElementBlock(block.kind, block.entity, (group,), []) for group in block.groups]


def _format_number(value):
    return repr(float(value)) if isinstance(value, float) else str(value)


class _SectionNumberReader:
    """Sequential reader of the numbers in a text or binary section."""

    def __init__(self, data, binary, order, size):
        self.data, self.binary, self.order, self.size, self.position = data, binary, order, size, 0
        self.words = iter(() if binary else data.split())

    def read_numbers(self, struct_letters):
        if not self.binary:
            return [
                float(next(self.words)) if c == "d" else int(next(self.words))
                for c in struct_letters
            ]
        layout = self.order + struct_letters.replace("q", self.size)
        values = struct.unpack_from(layout, self.data, self.position)
        self.position += struct.calcsize(layout)
        return list(values)

    def read_count_line(self):
        if not self.binary:
            return int(next(self.words))
        end = self.data.index(b"\n", self.position)
        value, self.position = int(self.data[self.position : end]), end + 1
        return value


def decode_msh(file_bytes):
    """Return the content of a mesh file, given as bytes."""
    sections = {}
    for match in re.finditer(rb"\$(\w+)[ \t]*\r?\n(.*?)\$End\1", file_bytes, re.DOTALL):
        sections.setdefault(match[1].decode(), match[2])
    format_line, _, byte_order_mark = sections["MeshFormat"].partition(b"\n")
    version, binary, size = format_line.decode().split()
    order = "<" if binary == "0" or byte_order_mark[:4] == b"\1\0\0\0" else ">"

    def make_section_reader(section_name):
        letter = "i" if size == "4" else "q"
        return _SectionNumberReader(sections[section_name], binary == "1", order, letter)

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
        node_source, element_source = make_section_reader("Nodes"), make_section_reader("Elements")
        nodes = [node_source.read_numbers("iddd") for _ in range(node_source.read_count_line())]
        n_left = element_source.read_count_line()
        while n_left > 0:
            if binary == "1":
                type_number, count, n_tags = element_source.read_numbers("iii")
            else:
                number, type_number, n_tags = element_source.read_numbers("iii")
                count = 1
            for _ in range(count):
                number = element_source.read_numbers("i")[0] if binary == "1" else number
                tags = element_source.read_numbers("i" * n_tags)
                group = abs(tags[0]) if tags else 0
                row = [
                    number,
                    *element_source.read_numbers("i" * N_NODES_BY_GMSH_TYPE[type_number]),
                ]
                blocks.append(ElementBlock(type_number, 0, (group,) if group else (), [row]))
            n_left -= count
        return MshFileContent(nodes, blocks, names)
    is_4_1, groups_of = version == "4.1", {}
    if "Entities" in sections:
        entity_source = make_section_reader("Entities")
        for dim, count in enumerate(entity_source.read_numbers("qqqq")):
            for _ in range(count):
                (entity,) = entity_source.read_numbers("i")
                entity_source.read_numbers("d" * (3 if is_4_1 and dim == 0 else 6))
                groups = entity_source.read_numbers("i" * entity_source.read_numbers("q")[0])
                if dim:
                    entity_source.read_numbers("i" * entity_source.read_numbers("q")[0])
                groups_of[dim, entity] = tuple({abs(group) for group in groups})
    node_source, element_source = make_section_reader("Nodes"), make_section_reader("Elements")
    for _ in range(node_source.read_numbers("qqqq" if is_4_1 else "qq")[0]):
        a, b, parametric, count = node_source.read_numbers("iiiq")
        parametric_letters = "d" * ((a if is_4_1 else b) * parametric)
        if is_4_1:
            numbers = [node_source.read_numbers("q")[0] for _ in range(count)]
            nodes += [
                [number, *node_source.read_numbers("ddd" + parametric_letters)[:3]]
                for number in numbers
            ]
        else:
            nodes += [
                node_source.read_numbers("iddd" + parametric_letters)[:4] for _ in range(count)
            ]
    for _ in range(element_source.read_numbers("qqqq" if is_4_1 else "qq")[0]):
        a, b, type_number, count = element_source.read_numbers("iiiq")
        entity = (a, b) if is_4_1 else (b, a)
        letters = ("q" if is_4_1 else "i") * (1 + N_NODES_BY_GMSH_TYPE[type_number])
        rows = [element_source.read_numbers(letters) for _ in range(count)]
        blocks.append(ElementBlock(type_number, entity[1], groups_of.get(entity, ()), rows))
    return MshFileContent(nodes, blocks, names)
