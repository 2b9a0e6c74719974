"""Meshes and sets of Abaqus' input files, which CalculiX and Gmsh write, too.

Numbering of nodes and faces: "Abaqus Analysis User's Guide", part VI; G. Dhondt, "CalculiX CrunchiX
User's Manual", version 2.20, section 6.2. What follows the model, from *STEP on, is not read.
"""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

# Faces S1, S2 ... by their corners
FACES = {
    "triangle": ("01", "12", "20"),
    "quadrilateral": ("01", "12", "23", "30"),
    "tetrahedron": ("012", "031", "132", "230"),
    "hexahedron": ("0123", "4765", "0451", "1562", "2673", "3740"),
}
# Types by the number in their names: dimension, cell, degree of its sides, nodes
SOLID = {"4": (3, "tetrahedron", 1, 4), "10": (3, "tetrahedron", 2, 10)}
SOLID["8"] = (3, "hexahedron", 1, 8)
FLAT = {"3": (2, "triangle", 1, 3), "4": (2, "quadrilateral", 1, 4)}
FLAT["6"] = FLAT["65"] = (2, "triangle", 2, 6)
LINE = {"2": (1, "interval", 1, 2), "3": (1, "interval", 2, 3)}
TYPES = (
    (r"D?C3D(\d+)[A-Z]*", SOLID, "C3D10, C3D4 or C3D8"),
    (r"(?:CPS|CPEG?|CG?AX|DC2D|DCAX|S|STRI|SFM3D|M3D)(\d+)[A-Z]*\d?", FLAT, "CPS6, CPS3 or CPS4"),
    (r"T[23]D(\d)[A-Z]*", LINE, "T3D3"),
)
NO_CELLS = "(MASS|ROTARYI|SPRING|DASHPOT|CONN|GAP|R2D2|R3D|RAX2).*"
NOT_READ = ("NGEN", "NFILL", "NCOPY", "NMAP", "ELGEN", "ELCOPY", "SYSTEM", "IMPORT")

Params = dict[str, str]
Rows = list[list[str]]
Key = tuple[str, int]  # part ("" outside of parts) and number
Sets = dict[tuple[str, str], list[Any]]  # by part and name


class Model:
    """Nodes, elements, sets of their keys, surfaces of (kind of set, face, or "" for all, key)."""

    def __init__(self, path: Path) -> None:
        self.nodes: dict[Key, list[float]] = {}
        self.elements: dict[Key, tuple[tuple[int, str, int, int], list[Key]]] = {}
        self.sets: dict[str, Sets] = {"NSET": {}, "ELSET": {}, "SURFACE": {}}
        self.instances: dict[str, str] = {}  # the part of each
        self.part = ""
        for keyword, given, rows in _blocks(path):
            if keyword == "STEP":
                break
            try:
                self._add(keyword, given, rows)
            except KeyError as error:
                raise ValueError(f"{path}, *{keyword}: {error.args[0]}=... is missing") from error
            except (IndexError, ValueError) as error:
                raise ValueError(f"{path}, *{keyword}: {error}") from error

    def _add(self, keyword: str, given: Params, rows: Rows) -> None:
        if keyword in NOT_READ or (keyword == "NODE" and "SYSTEM" in given):
            raise ValueError("this is not read: write all nodes and elements out, in x, y, z")
        if keyword in ("PART", "END PART"):
            self.part = given.get("NAME", "")
        elif keyword == "INSTANCE":
            self._place(given["NAME"], given["PART"], [[*map(float, row)] for row in rows])
        elif keyword == "NODE":
            x = {(self.part, int(k)): [*map(float, at), 0.0][:3] for k, *at in rows}
            self.nodes |= x
            self._extend("NSET", given.get("NSET"), [*x])
        elif keyword == "ELEMENT" and re.fullmatch(NO_CELLS, given["TYPE"]):
            self._extend("ELSET", given.get("ELSET"), [])
        elif keyword == "ELEMENT":
            kind = _kind(given["TYPE"])
            keys, step = [(self.part, int(k)) for row in rows for k in row], kind[3] + 1
            if len(keys) % step:
                raise ValueError(f"{given['TYPE']} has {step - 1} nodes: some here have others")
            for start in range(0, len(keys), step):
                self.elements[keys[start]] = kind, keys[start + 1 : start + step]
            self._extend("ELSET", given.get("ELSET"), keys[::step])
        elif keyword in ("NSET", "ELSET"):
            part = self.instances.get(given.get("INSTANCE", ""), self.part)
            for row in rows:
                if "GENERATE" in given:
                    if len(row) not in (2, 3):
                        raise ValueError("GENERATE takes the first number, the last, and the step")
                    first, last, by = [*map(int, row), 1][:3]
                    row = [str(k) for k in range(first, last + 1, by)]
                members = [key for one in row for key in self._members(keyword, one, part)]
                self._extend(keyword, given[keyword], members)
        elif keyword == "SURFACE":
            kind_of = {"NODE": "NSET", "ELEMENT": "ELSET"}.get(given.get("TYPE", "ELEMENT"))
            if "COMBINE" in given:
                raise ValueError("COMBINE is not read: name the faces of the whole surface")
            for one, *face in rows if kind_of else ():  # others are not made of faces
                of = face[0] if face and kind_of == "ELSET" else ""
                keys = self._members(str(kind_of), one, self.part)
                self._extend("SURFACE", given["NAME"], [(kind_of, of, key) for key in keys])

    def _place(self, name: str, part: str, rows: list[list[float]]) -> None:
        if part in self.instances.values() or len(rows) > 1:
            raise ValueError(f"{name}: parts that are turned, or used twice, are not read")
        self.instances[name] = part
        for key, x in self.nodes.items():
            if rows and key[0] == part:
                x[:] = [a + b for a, b in zip(x, rows[0], strict=True)]

    def _extend(self, kind: str, name: str | None, members: list[Any]) -> None:
        if name:
            self.sets[kind].setdefault((self.part, name), []).extend(members)

    def _members(self, kind: str, one: str, part: str) -> list[Any]:
        instance, _, name = one.rpartition(".")
        part = self.instances.get(instance, part)
        if name.isdigit():
            return [(part, int(name))]
        if (part, name) not in self.sets[kind]:
            raise ValueError(f"the {kind} {one} is not defined before")
        return self.sets[kind][part, name]


def _kind(name: str) -> tuple[int, str, int, int]:
    for pattern, known, others in TYPES:
        if match := re.fullmatch(pattern, name):
            if match[1] in known:
                return known[match[1]]
            reason = f"since DOLFINx has no cells with their nodes: mesh with {others}"
            raise ValueError(f"elements {name} are not read, {reason}")
    raise ValueError(f"elements {name} are not read")


def _blocks(path: Path) -> Iterator[tuple[str, Params, Rows]]:
    """Keyword, parameters and rows of entries of each block, all in capitals."""
    head, rows = list[str](), Rows()
    for line in [*_lines(path, ()), "*"]:
        entries = [" ".join(entry.split()).upper() for entry in line.rstrip(",").split(",")]
        if not line.startswith("*"):
            rows.append(entries)
            continue
        if head:
            pairs = [entry.partition("=")[::2] for entry in head[1:]]
            yield head[0][1:].strip(), {k.strip(): v.strip(' "') for k, v in pairs}, rows
        head, rows = entries, []


def _lines(path: Path, within: tuple[Path, ...]) -> Iterator[str]:
    """Lines that say something, those of included files, too; a keyword's are one."""
    if not path.is_file() or path in within:
        raise FileNotFoundError(f"there is no file {path}, or it includes itself")
    text = re.sub(r"(?m)^\*\*.*$", "", path.read_text(errors="replace"))
    text = re.sub(r"(?m)^(\*.*,)[ \t]*\n", r"\1", text)
    for line in filter(None, map(str.strip, text.splitlines())):
        match = re.match(r"(?i)\*include.*input *= *\"?([^\",]+)", line)
        yield from _lines(path.parent / match[1], (*within, path)) if match else [line]
