"""Parser of Gmsh's mesh files (`.msh`): formats 2 to 4.1, text and binary.

When Gmsh opens a file, it runs a script whatever the file's name, reads options from the user's
folders, and does not check the numbers of a mesh. This parser therefore does not use Gmsh: it reads
and checks all numbers itself.

The formats are described in the "Gmsh Reference Manual", version 4.13, chapter "Gmsh file formats".
Only the sections of nodes, elements, entities and names are read.
"""

import re
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from pw_elements.meshes.elements import gmsh_element_type
from pw_elements.meshes.groups import GmshMesh
from pw_elements.meshes.rows import BinaryRowReader, SectionRowReader, TextRowReader

_PARSER_VERSION_BY_MSH_FORMAT = {
    "2": 2.0,
    "2.0": 2.0,
    "2.1": 2.0,
    "2.2": 2.0,
    "4": 4.0,
    "4.0": 4.0,
    "4.1": 4.1,
}
_SECTION_HEADER_PATTERN = re.compile(rb"\s*\$([A-Za-z]\w*)[ \t]*\r?\n")
_PHYSICAL_NAME_PATTERN = re.compile(r'\s*([0-3])\s+(\d{1,10})\s+"(.*)"\s*')
# Sections that are read; each of them may occur only once
_NAMES_OF_SECTIONS_READ = {
    "MeshFormat",
    "PhysicalNames",
    "Entities",
    "PartitionedEntities",
    "Nodes",
    "Elements",
}
_N_BYTES_TO_DETECT_FORMAT = 4096  # number of bytes by which a format is recognised


def read_msh(path: Path) -> GmshMesh:
    """Read nodes, elements and physical groups from a mesh file of Gmsh.

    Args:
        path: path of the file.

    Raises:
        FileNotFoundError: if the file does not exist.
        ValueError: if the file has another format, or contains contradictory numbers.
    """
    if not path.is_file():
        raise FileNotFoundError(f"there is no file {path}")
    with path.open("rb") as file:
        data = file.read(_N_BYTES_TO_DETECT_FORMAT)
        if not data.lstrip().startswith(b"$"):
            raise ValueError(
                "it is no mesh file of Gmsh, which begins with $MeshFormat. Scripts (.geo) are not "
                "run: run them in Gmsh, and save the mesh or give gmsh.model"
            )
        data += file.read()
    with warnings.catch_warnings():
        # NumPy's warning of words among numbers; see `_parse_rows`
        warnings.filterwarnings("error", "string or file could not be read", DeprecationWarning)
        return _MshReader(data).read()


def _split_sections(data: bytes) -> dict[str, bytes]:
    """Return the content of each section by its name; it is empty for sections that are not used.

    Raises:
        ValueError: if a section is incomplete, repeated or missing.
    """
    sections: dict[str, bytes] = {}
    position = 0
    while match := _SECTION_HEADER_PATTERN.match(data, position):
        name, start = match[1].decode(), match.end()
        end = data.find(b"$End" + match[1], start)
        if end < 0:
            raise ValueError(f"${name} has no $End{name}: the file is not complete")
        if name in sections and name in _NAMES_OF_SECTIONS_READ:
            raise ValueError(f"it has two sections ${name}")
        if not sections and name not in ("MeshFormat", "Comments"):
            raise ValueError(
                f"it begins with ${name} in place of $MeshFormat; save it as format 4.1"
            )
        sections[name] = data[start:end] if name in _NAMES_OF_SECTIONS_READ else b""
        position = end + len(b"$End" + match[1])
        if data[position : position + 1].strip():
            raise ValueError(f"${name} does not end with $End{name}")
    if remainder := data[position : position + 60].strip():
        first_line = remainder.decode("ascii", "replace").split("\n")[0]
        raise ValueError(f"'{first_line}' stands between its sections")
    if "ParametricNodes" in sections:
        raise ValueError("$ParametricNodes is not read: save it with Mesh.SaveParametric = 0")
    for name in ("MeshFormat", "Nodes", "Elements"):
        if name not in sections:
            raise ValueError(f"it has no section ${name}")
    return sections


def _decode_utf8_or_latin1(line: bytes) -> str:
    try:
        return line.decode()
    except UnicodeDecodeError:  # written in a local encoding
        return line.decode("latin-1")


class _MshReader:
    """Reader that creates a `GmshMesh` from the sections of a file."""

    def __init__(self, data: bytes) -> None:
        self._sections = _split_sections(data)
        format_line, _, after_format = self._sections["MeshFormat"].partition(b"\n")
        words = format_line.decode("ascii", "replace").split()
        if (
            len(words) != 3
            or words[0] not in _PARSER_VERSION_BY_MSH_FORMAT
            or words[1] not in ("0", "1")
        ):
            raise ValueError(
                f"its format is '{' '.join(words)[:40]}', not 2 to 2.2, 4.0 or 4.1: save it as one "
                "of these (Gmsh's option Mesh.MshFileVersion)"
            )
        self._version, self._is_binary = _PARSER_VERSION_BY_MSH_FORMAT[words[0]], words[1] == "1"
        self._byte_order, self._count_letter = "<", "q"
        if self._is_binary:
            if words[2] not in ("4", "8") or (words[2] == "4" and self._version < 4.1):
                raise ValueError(f"its numbers have {words[2][:20]} bytes, not 8")
            self._count_letter = "i" if words[2] == "4" else "q"
            byte_order_of = {b"\1\0\0\0": "<", b"\0\0\0\1": ">"}
            if after_format[:4] not in byte_order_of:
                raise ValueError("$MeshFormat has no number 1 that tells the order of bytes")
            self._byte_order = byte_order_of[after_format[:4]]
        if "PartitionedEntities" in self._sections:
            raise ValueError("it is partitioned: save it as one (Gmsh's unpartition)")
        self._mesh = GmshMesh()
        self._combination_of_entity: dict[tuple[int, int], int] = {}  # by dimension and entity

    def read(self) -> GmshMesh:
        if "PhysicalNames" in self._sections:
            self._read_physical_names()
        if self._version < 4:
            with self._open_section("Nodes") as rows:
                numbers, x = rows.read_table(rows.read_count(), "i", 1, 3)
                self._mesh.add_nodes(numbers[:, 0], x)
            with self._open_section("Elements") as rows:
                self._read_format_2_elements(rows)
            return self._mesh
        if "Entities" in self._sections:
            with self._open_section("Entities") as rows:
                self._read_groups_of_entities(rows)
        with self._open_section("Nodes") as rows:
            self._read_node_blocks(rows)
        with self._open_section("Elements") as rows:
            self._read_element_blocks(rows)
        return self._mesh

    @contextmanager
    def _open_section(self, name: str) -> Iterator[SectionRowReader]:
        """Yield a reader of a section; at the end of the block, check that all rows were read.

        The messages of ValueErrors raised in the block are prefixed with the section's name.
        """
        try:
            section = self._sections[name]
            rows: SectionRowReader
            if self._is_binary:
                rows = BinaryRowReader(section, self._byte_order, self._count_letter)
            else:
                rows = TextRowReader(section)
            yield rows
            rows.check_all_rows_read()
        except ValueError as error:
            raise ValueError(f"${name}: {error}") from error

    def _read_physical_names(self) -> None:
        lines = [line for line in self._sections["PhysicalNames"].split(b"\n") if line.strip()]
        if not lines or lines[0].strip() != b"%d" % (len(lines) - 1):
            raise ValueError("$PhysicalNames: the names are not as many as it states")
        for line in map(_decode_utf8_or_latin1, lines[1:]):
            if not (name_match := _PHYSICAL_NAME_PATTERN.fullmatch(line)):
                raise ValueError(
                    f"$PhysicalNames: '{line.strip()[:60]}' is no dimension, number and name"
                )
            self._mesh.add_group_name(int(name_match[1]), int(name_match[2]), name_match[3])

    def _read_format_2_elements(self, rows: SectionRowReader) -> None:
        for type_number, n_tags, integers in rows.read_format_2_elements_by_type(rows.read_count()):
            group_of_element = (
                np.abs(integers[:, 1]) if n_tags else np.zeros(len(integers), dtype=np.int64)
            )
            groups, group_index = np.unique(group_of_element, return_inverse=True)
            combinations = [
                self._mesh.find_or_add_group_combination({int(g)} - {0}) for g in groups
            ]
            self._mesh.add_elements(
                type_number,
                integers[:, 0],
                integers[:, 1 + n_tags :],
                np.array(combinations)[group_index],
            )

    def _read_groups_of_entities(self, rows: SectionRowReader) -> None:
        for dim, count in enumerate(rows.read_integers("qqqq")):
            for _ in range(count):
                is_point = dim == 0 and self._version > 4
                number, groups = rows.read_entity_number_and_groups(
                    3 if is_point else 6, has_bounding_entities=dim > 0
                )
                if (dim, number) in self._combination_of_entity:
                    raise ValueError(f"entity {number} of dimension {dim} is there twice")
                # the number of a group is negative if the orientation of the entity is reversed
                group_numbers = {abs(group) for group in groups} - {0}
                self._combination_of_entity[dim, number] = self._mesh.find_or_add_group_combination(
                    group_numbers
                )

    def _read_node_blocks(self, rows: SectionRowReader) -> None:
        for dim, _, is_parametric, count in self._read_block_headers(rows):
            if dim not in range(4) or is_parametric not in (0, 1):
                raise ValueError(f"a block has dimension {dim}, and {is_parametric} for parametric")
            n_floats = 3 + dim * is_parametric
            if self._version > 4:
                numbers, _ = rows.read_table(count, "q", 1, 0)
                _, x = rows.read_table(count, "q", 0, n_floats)
            else:
                numbers, x = rows.read_table(count, "i", 1, n_floats)
            self._mesh.add_nodes(numbers[:, 0], x[:, :3])

    def _read_element_blocks(self, rows: SectionRowReader) -> None:
        for dim, entity, type_number, count in self._read_block_headers(rows):
            element_type = gmsh_element_type(type_number)
            if dim != element_type.dim:
                raise ValueError(
                    f"entity {entity} of dimension {dim} has {element_type.describe()}"
                )
            if "Entities" in self._sections and (dim, entity) not in self._combination_of_entity:
                raise ValueError(f"entity {entity} of dimension {dim} is not in $Entities")
            if count == 0:
                continue
            letter = "q" if self._version > 4 else "i"
            integers, _ = rows.read_table(count, letter, 1 + element_type.n_nodes, 0)
            combinations = np.full(count, self._combination_of_entity.get((dim, entity), 0))
            self._mesh.add_elements(type_number, integers[:, 0], integers[:, 1:], combinations)

    def _read_block_headers(self, rows: SectionRowReader) -> Iterator[tuple[int, int, int, int]]:
        """Yield the header of each block of a section in format 4.

        The caller has to read the rows of the block before the next header.

        Yields:
            Dimension and number of the entity; parametric flag (blocks of nodes) or element type
            (blocks of elements); and number of nodes or elements in the block.

        Raises:
            ValueError: if the numbers of nodes or elements in the blocks do not add up to the total
                at the start of the section.
        """
        n_blocks, n_stated, *_ = rows.read_integers("qqqq" if self._version > 4 else "qq")
        n_read = 0
        for _ in range(n_blocks):
            dim, entity, block_type, count = rows.read_integers("iiiq")
            if self._version == 4:
                dim, entity = entity, dim
            yield dim, entity, block_type, count
            n_read += count
        if n_read != n_stated:
            raise ValueError(f"it states {n_stated} in all, its blocks have {n_read}")
