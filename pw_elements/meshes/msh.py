"""Gmsh's mesh files (`.msh`), read as data: formats 2 to 4.1, as text and in binary.

Gmsh runs a file that is a script, whatever its name, reads options from the user's folders, and
trusts the numbers of a mesh. So it is not asked: all numbers are read here, and checked.

Formats: "Gmsh Reference Manual", version 4.13, chapter "Gmsh file formats". Sections other than
those of nodes, elements, entities and names are passed over.
"""

import re
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from pw_elements.meshes.elements import kind_of
from pw_elements.meshes.groups import GroupedMesh
from pw_elements.meshes.rows import BinaryRows, Rows, TextRows

_VERSIONS = {"2": 2.0, "2.0": 2.0, "2.1": 2.0, "2.2": 2.0, "4": 4.0, "4.0": 4.0, "4.1": 4.1}
_HEADER = re.compile(rb"\s*\$([A-Za-z]\w*)[ \t]*\r?\n")
_NAME = re.compile(r'\s*([0-3])\s+(\d{1,10})\s+"(.*)"\s*')
# Sections that are read, and so have to be there once at most
_READ = {"MeshFormat", "PhysicalNames", "Entities", "PartitionedEntities", "Nodes", "Elements"}
_BYTES_TO_TELL = 4096  # of the file's beginning, by which it is told from others


def read_msh(path: Path) -> GroupedMesh:
    """Read nodes, elements and physical groups of a mesh file of Gmsh.

    Args:
        path: of the file.

    Raises:
        FileNotFoundError: if there is no such file.
        ValueError: for a file of another kind, or one whose numbers do not agree with each other.
    """
    if not path.is_file():
        raise FileNotFoundError(f"there is no file {path}")
    with path.open("rb") as file:
        data = file.read(_BYTES_TO_TELL)
        if not data.lstrip().startswith(b"$"):
            raise ValueError(
                "it is no mesh file of Gmsh, which begins with $MeshFormat. Scripts (.geo) are not "
                "run: run them in Gmsh, and save the mesh or give gmsh.model"
            )
        data += file.read()
    with warnings.catch_warnings():
        warnings.simplefilter("error", DeprecationWarning)  # NumPy's, of words among numbers
        return _Reader(data).read()


def _split_sections(data: bytes) -> dict[str, bytes]:
    sections: dict[str, bytes] = {}
    position = 0
    while match := _HEADER.match(data, position):
        name, start = match[1].decode(), match.end()
        end = data.find(b"$End" + match[1], start)
        if end < 0:
            raise ValueError(f"${name} has no $End{name}: the file is not complete")
        if name in sections and name in _READ:
            raise ValueError(f"it has two sections ${name}")
        if not sections and name not in ("MeshFormat", "Comments"):
            raise ValueError(
                f"it begins with ${name} in place of $MeshFormat; save it as format 4.1"
            )
        sections[name] = data[start:end] if name in _READ else b""
        position = end + len(b"$End" + match[1])
        if data[position : position + 1].strip():
            raise ValueError(f"${name} does not end with $End{name}")
    if rest := data[position : position + 60].strip():
        words = rest.decode("ascii", "replace").split("\n")[0]
        raise ValueError(f"'{words}' stands between its sections")
    if "ParametricNodes" in sections:
        raise ValueError("$ParametricNodes is not read: save it with Mesh.SaveParametric = 0")
    for name in ("MeshFormat", "Nodes", "Elements"):
        if name not in sections:
            raise ValueError(f"it has no section ${name}")
    return sections


def _decode(line: bytes) -> str:
    try:
        return line.decode()
    except UnicodeDecodeError:  # of a program that writes in the encoding of its place
        return line.decode("latin-1")


class _Reader:
    def __init__(self, data: bytes) -> None:
        self._sections = _split_sections(data)
        head, _, rest = self._sections["MeshFormat"].partition(b"\n")
        words = head.decode("ascii", "replace").split()
        if len(words) != 3 or words[0] not in _VERSIONS or words[1] not in ("0", "1"):
            raise ValueError(
                f"its format is '{' '.join(words)[:40]}', not 2 to 2.2, 4.0 or 4.1: save it as one "
                "of these (Gmsh's option Mesh.MshFileVersion)"
            )
        self._version, self._is_binary = _VERSIONS[words[0]], words[1] == "1"
        self._order, self._count_letter = "<", "q"
        if self._is_binary:
            if words[2] not in ("4", "8") or (words[2] == "4" and self._version < 4.1):
                raise ValueError(f"its numbers have {words[2][:20]} bytes, not 8")
            self._count_letter = "i" if words[2] == "4" else "q"
            orders = {b"\1\0\0\0": "<", b"\0\0\0\1": ">"}
            if rest[:4] not in orders:
                raise ValueError("$MeshFormat has no number 1 that tells the order of bytes")
            self._order = orders[rest[:4]]
        if "PartitionedEntities" in self._sections:
            raise ValueError("it is partitioned: save it as one (Gmsh's unpartition)")
        self._mesh = GroupedMesh()
        self._combination: dict[tuple[int, int], int] = {}  # of groups, of each entity

    def read(self) -> GroupedMesh:
        if "PhysicalNames" in self._sections:
            self._read_names()
        if self._version < 4:
            with self._section("Nodes") as rows:
                numbers, x = rows.table(rows.count(), "i", 1, 3)
                self._mesh.add_nodes(numbers[:, 0], x)
            with self._section("Elements") as rows:
                self._read_tagged_elements(rows)
            return self._mesh
        if "Entities" in self._sections:
            with self._section("Entities") as rows:
                self._read_entities(rows)
        with self._section("Nodes") as rows:
            self._read_node_blocks(rows)
        with self._section("Elements") as rows:
            self._read_element_blocks(rows)
        return self._mesh

    @contextmanager
    def _section(self, name: str) -> Iterator[Rows]:
        """Give the rows of a section, all of which have to be read; errors say where they are."""
        try:
            section = self._sections[name]
            rows: Rows
            if self._is_binary:
                rows = BinaryRows(section, self._order, self._count_letter)
            else:
                rows = TextRows(section)
            yield rows
            rows.finish()
        except ValueError as error:
            raise ValueError(f"${name}: {error}") from error

    def _read_names(self) -> None:
        lines = [line for line in self._sections["PhysicalNames"].split(b"\n") if line.strip()]
        if not lines or lines[0].strip() != b"%d" % (len(lines) - 1):
            raise ValueError("$PhysicalNames: the names are not as many as it states")
        for line in map(_decode, lines[1:]):
            if not (match := _NAME.fullmatch(line)):
                raise ValueError(
                    f"$PhysicalNames: '{line.strip()[:60]}' is no dimension, number and name"
                )
            self._mesh.add_name(int(match[1]), int(match[2]), match[3])

    def _read_tagged_elements(self, rows: Rows) -> None:
        for kind, n_tags, integers in rows.tagged_elements(rows.count()):
            group = np.abs(integers[:, 1]) if n_tags else np.zeros(len(integers), dtype=np.int64)
            groups, member = np.unique(group, return_inverse=True)
            combinations = [self._mesh.add_combination({int(g)} - {0}) for g in groups]
            self._mesh.add_elements(
                kind, integers[:, 0], integers[:, 1 + n_tags :], np.array(combinations)[member]
            )

    def _read_entities(self, rows: Rows) -> None:
        for dim, count in enumerate(rows.integers("qqqq")):
            for _ in range(count):
                is_point = dim == 0 and self._version > 4
                number, groups = rows.entity(3 if is_point else 6, bounded=dim > 0)
                if (dim, number) in self._combination:
                    raise ValueError(f"entity {number} of dimension {dim} is there twice")
                # the number of a group is negative where the entity is turned round
                members = {abs(group) for group in groups} - {0}
                self._combination[dim, number] = self._mesh.add_combination(members)

    def _read_node_blocks(self, rows: Rows) -> None:
        for dim, _, parametric, count in self._blocks(rows):
            if dim not in range(4) or parametric not in (0, 1):
                raise ValueError(f"a block has dimension {dim}, and {parametric} for parametric")
            n_floats = 3 + dim * parametric
            if self._version > 4:
                numbers, _ = rows.table(count, "q", 1, 0)
                _, x = rows.table(count, "q", 0, n_floats)
            else:
                numbers, x = rows.table(count, "i", 1, n_floats)
            self._mesh.add_nodes(numbers[:, 0], x[:, :3])

    def _read_element_blocks(self, rows: Rows) -> None:
        for dim, entity, number, count in self._blocks(rows):
            kind = kind_of(number)
            if dim != kind.dim:
                raise ValueError(f"entity {entity} of dimension {dim} has {kind.describe()}")
            if "Entities" in self._sections and (dim, entity) not in self._combination:
                raise ValueError(f"entity {entity} of dimension {dim} is not in $Entities")
            if count == 0:
                continue
            letter = "q" if self._version > 4 else "i"
            integers, _ = rows.table(count, letter, 1 + kind.n_nodes, 0)
            combinations = np.full(count, self._combination.get((dim, entity), 0))
            self._mesh.add_elements(number, integers[:, 0], integers[:, 1:], combinations)

    def _blocks(self, rows: Rows) -> Iterator[tuple[int, int, int, int]]:
        """Give dimension, entity, sort and count of each block of format 4, which is read then."""
        n_blocks, stated, *_ = rows.integers("qqqq" if self._version > 4 else "qq")
        total = 0
        for _ in range(n_blocks):
            dim, entity, sort, count = rows.integers("iiiq")
            if self._version == 4:
                dim, entity = entity, dim
            yield dim, entity, sort, count
            total += count
        if total != stated:
            raise ValueError(f"it states {stated} in all, its blocks have {total}")
