"""Independent reader of Abaqus' input files (decks), which shares no code with the library.

It reads decks without parts. Cells and facets are represented by frozen sets of the coordinates of
their corners. Coordinates are compared exactly.
"""

import re
from collections import Counter
from itertools import product

import numpy as np

QUAD_EDGES = ((1, 2), (2, 3), (3, 4), (4, 1))
TRIANGLE_EDGES = ((1, 2), (2, 3), (3, 1))
# Nodes of each face, counted from 1, corners first, by (kind, number of nodes of the element).
# Source: section 6.2 of CalculiX's manual
ABAQUS_FACE_NODES_BY_ELEMENT = {
    ("plane", 3): TRIANGLE_EDGES,
    ("plane", 4): QUAD_EDGES,
    ("plane", 6): ((1, 2, 4), (2, 3, 5), (3, 1, 6)),
    ("plane", 8): ((1, 2, 5), (2, 3, 6), (3, 4, 7), (4, 1, 8)),
    ("solid", 4): ((1, 2, 3), (1, 4, 2), (2, 4, 3), (3, 4, 1)),
    ("solid", 10): (
        (1, 2, 3, 5, 6, 7),
        (1, 4, 2, 8, 9, 5),
        (2, 4, 3, 9, 10, 6),
        (3, 4, 1, 10, 8, 7),
    ),
    ("solid", 8): (
        (1, 2, 3, 4),
        (5, 8, 7, 6),
        (1, 5, 6, 2),
        (2, 6, 7, 3),
        (3, 7, 8, 4),
        (4, 8, 5, 1),
    ),
    ("solid", 20): (
        (1, 2, 3, 4, 9, 10, 11, 12),
        (5, 8, 7, 6, 16, 15, 14, 13),
        (1, 5, 6, 2, 17, 13, 18, 9),
        (2, 6, 7, 3, 18, 14, 19, 10),
        (3, 7, 8, 4, 19, 15, 20, 11),
        (4, 8, 5, 1, 20, 16, 17, 12),
    ),
}
CORNER_COUNTS_BY_ELEMENT = {("plane", 3): 3, ("plane", 6): 3, ("plane", 4): 4, ("plane", 8): 4}
CORNER_COUNTS_BY_ELEMENT |= {("solid", 4): 4, ("solid", 10): 4, ("solid", 8): 8, ("solid", 20): 8}


def parse_element_type(element_type):
    """Return "plane" or "solid", the number of nodes, and whether edges are called S3, S4 ...

    Return None for other element types.
    """
    type_match = re.fullmatch(r"D?(C3D|CPS|CPE|CAX|S|M3D)(\d+)[A-Z]*\d?", element_type)
    if not type_match:
        return None
    dimension_kind = "solid" if type_match[1] == "C3D" else "plane"
    return dimension_kind, int(type_match[2]), type_match[1] in ("S", "M3D")


class IndependentDeckReader:
    """Content of a deck: nodes, elements, sets of their numbers, and surfaces.

    A surface is a list of pairs: a set of numbers of elements and the name of their face, or a set
    of numbers of nodes and None.
    """

    def __init__(self, path):
        self.nodes, self.elements = {}, {}
        self.sets = {"NSET": {}, "ELSET": {}}
        self.surfaces = {}
        blocks = list(self._split_into_keyword_blocks(self._read_text_with_includes(path)))
        for keyword, options, rows in blocks:
            if keyword == "NODE":
                self._add_nodes(options, rows)
            elif keyword == "ELEMENT":
                self._add_elements(options, rows)
        for sort in ("ELSET", "NSET"):
            for keyword, options, rows in blocks:
                if keyword == sort:
                    self._add_set(sort, options, rows)
        for keyword, options, rows in blocks:
            if keyword == "SURFACE":
                self._add_surface(options, rows)

    def _read_text_with_includes(self, path):
        data = path.read_bytes()
        try:
            wide = data[:2] in (b"\xff\xfe", b"\xfe\xff")
            text = data.decode("utf-16" if wide else "utf-8-sig")
        except UnicodeDecodeError:
            text = data.decode("latin-1")
        lines = []
        for line in re.split("\r\n|\n|\r", text):
            match = re.match(r'(?i)\s*\*include\s*,\s*input\s*=\s*"?([^",]+)', line)
            lines += [self._read_text_with_includes(path.parent / match[1])] if match else [line]
        return "\n".join(lines)

    def _split_into_keyword_blocks(self, text):
        keyword, options, rows = "", {}, []
        for line in text.split("\n"):
            line = line.strip(" \t")
            if not line or line.startswith("**"):
                continue
            fields = re.findall(r'\s*((?:"[^"]*"|[^,"])+)', re.sub(",(?=,)", ", ", line))
            fields = [field.strip(" \t") for field in fields]
            if not line.startswith("*"):
                rows.append(fields)
                continue
            yield keyword, options, rows
            keyword, rows = self._unquote_or_uppercase(fields[0][1:]), []
            if keyword == "STEP":
                return
            pairs = (field.partition("=") for field in fields[1:])
            options = {
                self._unquote_or_uppercase(key): self._unquote_or_uppercase(value)
                for key, _, value in pairs
            }
        yield keyword, options, rows

    @staticmethod
    def _unquote_or_uppercase(text):
        text = text.strip(" \t")
        if text.startswith('"'):
            return text.strip('"')
        return "".join(c.upper() if c.isascii() else c for c in text if c not in " \t")

    def _add_nodes(self, options, rows):
        for number, *x in rows:
            x = [float(re.sub("[dD]", "e", c) or 0) for c in x[:3]] + [0.0, 0.0, 0.0]
            self.nodes[int(number)] = tuple(x[:3])
            if "NSET" in options:
                self.sets["NSET"].setdefault(options["NSET"], set()).add(int(number))

    def _add_elements(self, options, rows):
        numbers = iter([])
        rows = iter(rows)
        element_kind = parse_element_type(options["TYPE"])
        for row in rows:
            numbers = [int(n) for n in row if n]
            while element_kind and len(numbers) <= element_kind[1]:
                numbers += [int(n) for n in next(rows) if n]
            self.elements[numbers[0]] = (
                options["TYPE"],
                numbers[1 : element_kind[1] + 1 if element_kind else None],
            )
            if "ELSET" in options:
                self.sets["ELSET"].setdefault(options["ELSET"], set()).add(numbers[0])

    def _add_set(self, set_keyword, options, rows):
        members = self.sets[set_keyword].setdefault(options[set_keyword], set())
        numbers = self.nodes if set_keyword == "NSET" else self.elements
        for row in rows:
            if "GENERATE" in options:
                start, stop, step = [*map(int, row), 1][:3]
                members |= {n for n in numbers if start <= n <= stop and (n - start) % step == 0}
                continue
            for entry in filter(None, row):
                members |= (
                    {int(entry)}
                    if entry.isdigit()
                    else self.sets[set_keyword][self._unquote_or_uppercase(entry)]
                )

    def _add_surface(self, options, rows):
        surface_rows = self.surfaces.setdefault(options["NAME"], [])
        for member, *face in rows:
            if options.get("TYPE") == "NODE":
                surface_rows.append(
                    ({int(member)} if member.isdigit() else self._get_node_set(member), None)
                )
            else:
                name = self._unquote_or_uppercase(member)
                members = {int(name)} if name.isdigit() else self.sets["ELSET"][name]
                surface_rows.append((members, self._unquote_or_uppercase(face[0])))

    def _get_node_set(self, set_name):
        return self.sets["NSET"][self._unquote_or_uppercase(set_name)]

    def iterate_cells_of_highest_dimension(self):
        """Yield the number, the kind and the nodes of each element of the highest dimension."""
        has_solids = any(kind.startswith("C3D") for kind, _ in self.elements.values())
        for number, (kind, nodes) in self.elements.items():
            element_kind = parse_element_type(kind)
            if element_kind and (element_kind[0] == "solid") == has_solids:
                yield number, element_kind, nodes

    def _get_coordinate_set(self, node_numbers):
        return frozenset(self.nodes[n] for n in node_numbers)

    def get_cell_corners_by_set(self):
        """Return, by name, the corners of the cells in each ELSET that contains cells."""
        corners = {
            n: self._get_coordinate_set(nodes[: CORNER_COUNTS_BY_ELEMENT[element_kind[:2]]])
            for n, element_kind, nodes in self.iterate_cells_of_highest_dimension()
        }
        sets = {
            name: {corners[n] for n in members if n in corners}
            for name, members in self.sets["ELSET"].items()
        }
        return {name: members for name, members in sets.items() if members}

    def get_facet_corners_by_set(self):
        """Return, by name, the corners of the facets in each NSET and SURFACE that has facets."""
        faces, n_cells = {}, Counter()
        for number, element_kind, nodes in self.iterate_cells_of_highest_dimension():
            for k, face in enumerate(ABAQUS_FACE_NODES_BY_ELEMENT[element_kind[:2]], 1):
                face_nodes = [nodes[i - 1] for i in face]
                n_corners = (
                    2 if element_kind[0] == "plane" else 3 if element_kind[1] in (4, 10) else 4
                )
                faces[number, f"S{k + 2 * element_kind[2]}"] = (
                    frozenset(face_nodes[:n_corners]),
                    face_nodes,
                )
                n_cells[frozenset(face_nodes[:n_corners])] += 1
        outer_faces = [
            (corners, face_nodes) for corners, face_nodes in faces.values() if n_cells[corners] == 1
        ]

        def find_outer_facet_corners(node_numbers):
            return {
                self._get_coordinate_set(corners)
                for corners, face_nodes in outer_faces
                if node_numbers >= set(face_nodes)
            }

        sets = {name: find_outer_facet_corners(nodes) for name, nodes in self.sets["NSET"].items()}
        for name, rows in self.surfaces.items():
            sets[name] = set()
            for members, face in rows:
                if face is None:
                    sets[name] |= find_outer_facet_corners(members)
                else:
                    named_faces = [faces[n, face][0] for n in members if (n, face) in faces]
                    sets[name] |= {self._get_coordinate_set(corners) for corners in named_faces}
        return {name: facets for name, facets in sets.items() if facets}

    def compute_cell_volumes(self):
        """Return the volumes of all cells by their numbers."""
        return {
            number: compute_element_volume(np.array([self.nodes[n] for n in nodes]), element_kind)
            for number, element_kind, nodes in self.iterate_cells_of_highest_dimension()
        }


def compute_element_volume(node_coordinates, element_kind):
    """Return the volume of an element with nodes (n, 3), by Gauss quadrature of its Jacobian."""
    dimension_kind, n_nodes, _ = element_kind
    dim = 2 if dimension_kind == "plane" else 3
    simplex = (dimension_kind, n_nodes) in {("plane", 3), ("plane", 6), ("solid", 4), ("solid", 10)}
    if simplex:
        corners = np.vstack([np.zeros(dim), np.eye(dim)])
    else:
        ring = [(-1, -1), (1, -1), (1, 1), (-1, 1)]
        corners = np.array(
            ring if dim == 2 else [(*nodes, z) for z in (-1, 1) for nodes in ring], float
        )
    edges = {3: TRIANGLE_EDGES, 4: QUAD_EDGES}.get(len(corners), ())
    if dim == 3:
        edges = (*TRIANGLE_EDGES, (1, 4), (2, 4), (3, 4))
        if not simplex:
            upper = [(a + 4, b + 4) for a, b in QUAD_EDGES]
            edges = (*QUAD_EDGES, *upper, *((k, k + 4) for k in range(1, 5)))
    edge_middles = [(corners[a - 1] + corners[b - 1]) / 2 for a, b in edges]
    nodes = np.vstack([corners, *edge_middles])[:n_nodes]
    degree = 1 if n_nodes == len(corners) else 2
    powers = [
        p
        for p in product(range(degree + 1), repeat=dim)
        if (sum(p) <= degree if simplex else sum(k == 2 for k in p) <= 1)
    ]
    coefficients = np.linalg.inv(
        np.array([[np.prod(a ** np.array(p)) for p in powers] for a in nodes])
    )
    points, weights = np.polynomial.legendre.leggauss(5)
    integral = 0.0
    for index in product(range(5), repeat=dim):
        xi, w = points[list(index)], weights[list(index)].prod()
        if simplex:  # map the cube to the simplex
            t = (xi + 1) / 2
            w /= 2**dim
            if dim == 2:
                xi, w = np.array([t[0], t[1] * (1 - t[0])]), w * (1 - t[0])
            else:
                y = t[1] * (1 - t[0])
                z = t[2] * (1 - t[0] - y)
                xi, w = np.array([t[0], y, z]), w * (1 - t[0]) * (1 - t[0] - y)
        gradients = [
            [
                p[j] * np.prod([xi[i] ** (p[i] - (i == j)) for i in range(dim) if p[i] or i != j])
                if p[j]
                else 0.0
                for p in powers
            ]
            for j in range(dim)
        ]
        jacobian = np.array(gradients) @ coefficients @ node_coordinates[:, :dim]
        integral += w * abs(np.linalg.det(jacobian))
    return integral
