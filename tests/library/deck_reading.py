"""A second reading of Abaqus' decks, which shares no code with the library's.

It takes flat decks (no parts), in the plain way: the whole text at once, sets as Python's.
Cells and facets are given as frozen sets of their corners' coordinates; the numbers are compared
digit by digit.
"""

import re
from collections import Counter
from itertools import product

import numpy as np

QUAD_EDGES = ((1, 2), (2, 3), (3, 4), (4, 1))
TRIANGLE_EDGES = ((1, 2), (2, 3), (3, 1))
# faces by their nodes from 1, corners first: CalculiX' manual, 6.2
FACES = {
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
CORNERS = {("plane", 3): 3, ("plane", 6): 3, ("plane", 4): 4, ("plane", 8): 4}
CORNERS |= {("solid", 4): 4, ("solid", 10): 4, ("solid", 8): 8, ("solid", 20): 8}


def family(kind):
    """Return "plane" or "solid", the number of nodes, and whether edges are S3, S4 ..."""
    match = re.fullmatch(r"D?(C3D|CPS|CPE|CAX|S|M3D)(\d+)[A-Z]*\d?", kind)
    if not match:
        return None
    what = "solid" if match[1] == "C3D" else "plane"
    return what, int(match[2]), match[1] in ("S", "M3D")


class Reading:
    """Nodes, elements, sets of numbers, and surfaces (element, face from 1) of a deck."""

    def __init__(self, path):
        self.nodes, self.elements = {}, {}
        self.sets = {"NSET": {}, "ELSET": {}}
        self.surfaces = {}
        blocks = list(self._blocks(self._text(path)))
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

    def _text(self, path):
        data = path.read_bytes()
        try:
            wide = data[:2] in (b"\xff\xfe", b"\xfe\xff")
            text = data.decode("utf-16" if wide else "utf-8-sig")
        except UnicodeDecodeError:
            text = data.decode("latin-1")
        lines = []
        for line in re.split("\r\n|\n|\r", text):
            match = re.match(r'(?i)\s*\*include\s*,\s*input\s*=\s*"?([^",]+)', line)
            lines += [self._text(path.parent / match[1])] if match else [line]
        return "\n".join(lines)

    def _blocks(self, text):
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
            keyword, rows = self._name(fields[0][1:]), []
            if keyword == "STEP":
                return
            pairs = (field.partition("=") for field in fields[1:])
            options = {self._name(key): self._name(value) for key, _, value in pairs}
        yield keyword, options, rows

    @staticmethod
    def _name(text):
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
        known = family(options["TYPE"])
        for row in rows:
            numbers = [int(n) for n in row if n]
            while known and len(numbers) <= known[1]:
                numbers += [int(n) for n in next(rows) if n]
            self.elements[numbers[0]] = (
                options["TYPE"],
                numbers[1 : known[1] + 1 if known else None],
            )
            if "ELSET" in options:
                self.sets["ELSET"].setdefault(options["ELSET"], set()).add(numbers[0])

    def _add_set(self, sort, options, rows):
        own = self.sets[sort].setdefault(options[sort], set())
        known = self.nodes if sort == "NSET" else self.elements
        for row in rows:
            if "GENERATE" in options:
                first, last, step = [*map(int, row), 1][:3]
                own |= {n for n in known if first <= n <= last and (n - first) % step == 0}
                continue
            for entry in filter(None, row):
                own |= {int(entry)} if entry.isdigit() else self.sets[sort][self._name(entry)]

    def _add_surface(self, options, rows):
        own = self.surfaces.setdefault(options["NAME"], [])
        for member, *face in rows:
            if options.get("TYPE") == "NODE":
                own.append(({int(member)} if member.isdigit() else self._nodes(member), None))
            else:
                name = self._name(member)
                chosen = {int(name)} if name.isdigit() else self.sets["ELSET"][name]
                own.append((chosen, self._name(face[0])))

    def _nodes(self, member):
        return self.sets["NSET"][self._name(member)]

    def cells(self):
        """Elements of the highest dimension: number, what they are, nodes."""
        solid = any(kind.startswith("C3D") for kind, _ in self.elements.values())
        for number, (kind, nodes) in self.elements.items():
            what = family(kind)
            if what and (what[0] == "solid") == solid:
                yield number, what, nodes

    def _places(self, nodes):
        return frozenset(self.nodes[n] for n in nodes)

    def cell_sets(self):
        """Corners of the cells in each ELSET that has any."""
        corners = {n: self._places(nodes[: CORNERS[what[:2]]]) for n, what, nodes in self.cells()}
        sets = {
            name: {corners[n] for n in own if n in corners}
            for name, own in self.sets["ELSET"].items()
        }
        return {name: own for name, own in sets.items() if own}

    def facet_sets(self):
        """Corners of the facets in each NSET and SURFACE that has any."""
        faces, times = {}, Counter()
        for number, what, nodes in self.cells():
            for k, face in enumerate(FACES[what[:2]], 1):
                own = [nodes[i - 1] for i in face]
                size = 2 if what[0] == "plane" else 3 if what[1] in (4, 10) else 4
                faces[number, f"S{k + 2 * what[2]}"] = frozenset(own[:size]), own
                times[frozenset(own[:size])] += 1
        outer = [(corners, own) for corners, own in faces.values() if times[corners] == 1]

        def inside(chosen):
            return {self._places(corners) for corners, own in outer if chosen >= set(own)}

        sets = {name: inside(own) for name, own in self.sets["NSET"].items()}
        for name, rows in self.surfaces.items():
            sets[name] = set()
            for chosen, face in rows:
                if face is None:
                    sets[name] |= inside(chosen)
                else:
                    own = [faces[n, face][0] for n in chosen if (n, face) in faces]
                    sets[name] |= {self._places(corners) for corners in own}
        return {name: own for name, own in sets.items() if own}

    def volumes(self):
        """Volume of each cell, by number."""
        return {
            number: volume(np.array([self.nodes[n] for n in nodes]), what)
            for number, what, nodes in self.cells()
        }


def volume(x, what):
    """Gauss' integral over an element of nodes (n, 3), whose functions are found by their zeros."""
    kind, count, _ = what
    dim = 2 if kind == "plane" else 3
    simplex = (kind, count) in {("plane", 3), ("plane", 6), ("solid", 4), ("solid", 10)}
    if simplex:
        corners = np.vstack([np.zeros(dim), np.eye(dim)])
    else:
        ring = [(-1, -1), (1, -1), (1, 1), (-1, 1)]
        corners = np.array(ring if dim == 2 else [(*at, z) for z in (-1, 1) for at in ring], float)
    order = {3: TRIANGLE_EDGES, 4: QUAD_EDGES}.get(len(corners), ())
    if dim == 3:
        order = (*TRIANGLE_EDGES, (1, 4), (2, 4), (3, 4))
        if not simplex:
            upper = [(a + 4, b + 4) for a, b in QUAD_EDGES]
            order = (*QUAD_EDGES, *upper, *((k, k + 4) for k in range(1, 5)))
    middles = [(corners[a - 1] + corners[b - 1]) / 2 for a, b in order]
    at = np.vstack([corners, *middles])[:count]
    degree = 1 if count == len(corners) else 2
    powers = [
        p
        for p in product(range(degree + 1), repeat=dim)
        if (sum(p) <= degree if simplex else sum(k == 2 for k in p) <= 1)
    ]
    coefficients = np.linalg.inv(
        np.array([[np.prod(a ** np.array(p)) for p in powers] for a in at])
    )
    points, weights = np.polynomial.legendre.leggauss(5)
    total = 0.0
    for index in product(range(5), repeat=dim):
        xi, w = points[list(index)], weights[list(index)].prod()
        if simplex:  # the cube's image that collapses onto the simplex
            t = (xi + 1) / 2
            w /= 2**dim
            if dim == 2:
                xi, w = np.array([t[0], t[1] * (1 - t[0])]), w * (1 - t[0])
            else:
                y = t[1] * (1 - t[0])
                z = t[2] * (1 - t[0] - y)
                xi, w = np.array([t[0], y, z]), w * (1 - t[0]) * (1 - t[0] - y)
        slopes = [
            [
                p[j] * np.prod([xi[i] ** (p[i] - (i == j)) for i in range(dim) if p[i] or i != j])
                if p[j]
                else 0.0
                for p in powers
            ]
            for j in range(dim)
        ]
        jacobian = np.array(slopes) @ coefficients @ x[:, :dim]
        total += w * abs(np.linalg.det(jacobian))
    return total
