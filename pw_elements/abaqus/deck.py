"""Model of an Abaqus input file: tables of nodes, elements, sets and surfaces.

The first *STEP and all blocks after it are ignored. As in CalculiX, ELSETs, NSETs and SURFACEs may
precede the nodes and elements to which they refer.
"""

from array import array
from collections.abc import Iterator
from itertools import chain
from pathlib import Path
from typing import NamedTuple

import numpy as np

from pw_elements.abaqus.lines import (
    ErrorWithFileAndLine,
    KeywordBlock,
    is_unsigned_integer,
    normalize_name,
    parse_comma_separated_integers,
    parse_node_row,
    read_keyword_blocks,
    split_at_unquoted_commas,
)
from pw_elements.abaqus.types import AbaqusElementType, abaqus_element_type
from pw_elements.arrays import Indices
from pw_elements.checks import arguments

# Keywords that generate or move nodes or elements
REFUSED_MESH_KEYWORDS = {"NGEN", "NFILL", "NCOPY", "NMAP", "ELGEN", "ELCOPY", "SYSTEM", "IMPORT"}
REFUSED_MESH_KEYWORDS |= {"SYMMETRICMODELGENERATION", "MESHREFINEMENT", "SUBSTRUCTUREGENERATE"}
# Parameters that are read, or that may be ignored because they change neither nodes nor sets
ACCEPTED_PARAMETERS_BY_KEYWORD = {
    "NODE": {"NSET", "SYSTEM", "INTERNAL"},
    "ELEMENT": {"TYPE", "ELSET", "PARENT", "DLOAD", "SOLIDELEMENTNUMBERING", "INTERNAL"},
    "NSET": {"NSET", "GENERATE", "ELSET", "INSTANCE", "INTERNAL", "UNSORTED", "FREQUENCY"},
    "ELSET": {"ELSET", "GENERATE", "INSTANCE", "INTERNAL", "UNSORTED"},
    "SURFACE": {"NAME", "TYPE", "INTERNAL", "TRIM", "PROPERTY", "NOTHICK", "NOOFFSET"},
}
RELEVANT_KEYWORDS = (
    REFUSED_MESH_KEYWORDS
    | ACCEPTED_PARAMETERS_BY_KEYWORD.keys()
    | {"PART", "ENDPART", "INSTANCE", "ENDINSTANCE", "STEP"}
)
# The key of a node or element is its number plus this factor times the number of its part
KEY_OFFSET_PER_PART = 2**32
MAX_ELEMENT_TYPES = 1000
# Limit of the total number of members of all sets, in which keys compared with ranges are counted
# too: the first constant, plus the second constant times the number of nodes and elements
BASE_LIMIT_OF_TOTAL_SET_MEMBERS, TOTAL_SET_MEMBER_LIMIT_PER_NODE_OR_ELEMENT = 2_000_000, 20

PartNumberAndSetName = tuple[int, str]  # number of the part, and name of the set in the part


class SetReference(NamedTuple):
    """Reference to a set in the definition of another set or, with a face, of a surface."""

    set_kind: str
    name: PartNumberAndSetName
    face: str = ""


class SetDefinition(NamedTuple):
    """Block of the input file that defines members of a set or surface.

    Args:
        name: name of the set or surface.
        location: file, line and keyword of the block, used in error messages.
        set_kind: "NSET" if the members are nodes, "ELSET" if they are elements.
        keys: keys (n,) of members that are listed one by one.
        faces: name of a face for each key; "" if no face is named, as in sets.
        ranges: first key, last key and step of each range of members.
        references: other sets that are part of the set.
    """

    name: PartNumberAndSetName
    location: str
    set_kind: str
    keys: array
    faces: list[str]
    ranges: list[tuple[int, int, int]]
    references: list[SetReference]


class SurfaceMembers(NamedTuple):
    """Part of a surface: positions of nodes (kind "NSET"), or of elements and a face ("ELSET").

    The face is "" for nodes. It is also "" for elements of which all free faces belong to the
    surface.
    """

    set_kind: str
    face: str
    members: Indices


class AbaqusDeck:
    """Nodes, elements, sets and surfaces of an input file.

    Each node or element has a key, which is unique in the whole file. Its position is the index of
    the key in ascending order. Sets contain positions.

    Attributes:
        node_keys: keys (n,) of the nodes in ascending order.
        x: coordinates (n, 3) of the nodes.
        element_keys: keys (m,) of all elements, including unsupported ones, in ascending order.
        element_types: types of the elements in the file.
        type_index: index (m,) of each element's type in `element_types`.
        members: for each type, the positions of its elements in the order of the file.
        nodes: for each type, the keys (elements of the type, nodes) of the elements' nodes.
        sets: for "NSET" and "ELSET", a mapping from the name of each set to the positions of its
            nodes or elements in ascending order.
        surfaces: parts of each surface by its name.
        instance_names: name of the instance of each part that has one, by the part's number.
        notes: messages about data that were left out or changed.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.instance_names: dict[int, str] = {}
        self._part_of_instance: dict[str, int] = {}
        self.notes: list[str] = []
        self.sets: dict[str, dict[PartNumberAndSetName, Indices]] = {}
        self.surfaces: dict[PartNumberAndSetName, list[SurfaceMembers]] = {}
        self._part_numbers, self._current_part = {"": 0}, 0
        self._instance_offsets: dict[int, list[float]] = {}
        self._node_keys, self._coordinates = array("q"), array("d")
        self._type_index_by_name: dict[str, int] = {}
        self._element_keys, self._type_indices = array("q"), array("q")
        self._connectivity: list[array] = []
        self._overlong_rows: dict[str, int] = {}
        self._blocks: dict[str, list[SetDefinition]] = {"NSET": [], "ELSET": [], "SURFACE": []}
        # names of sets in blocks of nodes and elements, with the range of rows of the block
        self._rows_of_named_blocks: dict[str, list[tuple[PartNumberAndSetName, int, int]]] = {
            "NSET": [],
            "ELSET": [],
        }
        self._member_chunks: dict[str, dict[PartNumberAndSetName, list[Indices]]] = {
            "NSET": {},
            "ELSET": {},
        }
        self._sets_with_gaps: dict[str, None] = {}
        for block in read_keyword_blocks(path, RELEVANT_KEYWORDS):
            if block.keyword == "STEP":
                break
            try:
                self._parse_block(block)
            except KeyError as error:
                raise ValueError(f"{block.location}: {error.args[0]}=... is missing") from error
            except ErrorWithFileAndLine:
                raise
            except ValueError as error:
                raise ValueError(
                    f"{block.current_location()}, *{block.keyword}: {error}"
                ) from error
        self._build_node_and_element_tables()
        self._resolve_set_members("ELSET")
        self._resolve_set_members("NSET")
        self._resolve_surface_members()
        if self._sets_with_gaps:
            first_name, *other_names = self._sets_with_gaps
            suffix = f" and {len(other_names)} other sets" if other_names else ""
            self.notes.append(
                f"ranges of {first_name}{suffix} have numbers of nothing that is there"
            )

    # Blocks

    def _parse_block(self, block: KeywordBlock) -> None:
        keyword, parameters = block.keyword, block.parameters
        if keyword in REFUSED_MESH_KEYWORDS:
            raise ValueError("this is not read: write all nodes and elements out, in x, y, z")
        if unknown_parameters := parameters.keys() - ACCEPTED_PARAMETERS_BY_KEYWORD.get(
            keyword, parameters.keys()
        ):
            raise ValueError(f"the parameter {min(unknown_parameters)} is not read")
        match keyword:
            case "PART":
                self._current_part = self._add_part(
                    normalize_name(parameters["NAME"], block.location)
                )
            case "INSTANCE":
                self._add_instance(block)
            case "ENDPART" | "ENDINSTANCE":
                self._current_part = 0
            case "NODE":
                self._add_nodes(block)
            case "ELEMENT":
                self._add_elements(block)
            case "NSET" | "ELSET":
                self._add_set(block)
            case "SURFACE":
                self._add_surface(block)

    def _add_part(self, name: str) -> int:
        if name in self._part_numbers:
            raise ValueError(f"the part {name} is given twice")
        return self._part_numbers.setdefault(name, len(self._part_numbers))

    def _add_instance(self, block: KeywordBlock) -> None:
        name, part_name = (
            normalize_name(block.parameters[key], block.location) for key in ("NAME", "PART")
        )
        offset_rows = [text.split(",") for text in block.rows]
        part_number = self._part_numbers.get(part_name, -1)
        if name in self._part_of_instance:
            raise ValueError(f"the instance {name} is given twice")
        if part_number < 1:
            raise ValueError(f"{name}: there is no part {part_name} before it")
        if (
            part_number in self.instance_names
            or len(offset_rows) > 1
            or len(offset_rows[:1] and offset_rows[0]) > 4
        ):
            raise ValueError(f"{name}: parts that are turned, or used twice, are not read")
        self.instance_names[part_number] = name
        self._part_of_instance[name] = part_number
        self._current_part = part_number  # an instance may define nodes and elements, too
        offset_row = ",".join(["1", *offset_rows[0]]) if offset_rows else "1"
        self._instance_offsets[part_number] = parse_node_row(offset_row)[1]

    def _add_nodes(self, block: KeywordBlock) -> None:
        if block.parameters.get("SYSTEM", "R").upper() != "R":
            raise ValueError("SYSTEM is not read: write the nodes in x, y, z")
        if any(self._instance_offsets.get(self._current_part, ())):
            raise ValueError("nodes in an instance that is moved are not read")
        start, key_offset = len(self._node_keys), KEY_OFFSET_PER_PART * self._current_part
        for text in block.rows:
            number, x = parse_node_row(text)
            self._node_keys.append(key_offset + number)
            self._coordinates.extend(x)
        self._record_set_named_in_block("NSET", block, start, len(self._node_keys))
        largest = max(map(abs, self._coordinates[3 * start :]), default=0.0)
        if not largest <= arguments.MAX_ARGUMENT_MAGNITUDE:
            raise ValueError(
                f"a coordinate is of the size {largest:.3g}, larger than "
                f"{arguments.MAX_ARGUMENT_MAGNITUDE:g}"
            )

    def _add_elements(self, block: KeywordBlock) -> None:
        name = normalize_name(block.parameters["TYPE"], block.location)
        element_type = abaqus_element_type(name)
        type_index = self._type_index_by_name.setdefault(name, len(self._type_index_by_name))
        if type_index >= MAX_ELEMENT_TYPES:
            raise ValueError(f"there are more than {MAX_ELEMENT_TYPES} types of elements")
        if type_index == len(self._connectivity):
            self._connectivity.append(array("q"))
        connectivity = self._connectivity[type_index]
        start, key_offset = len(self._element_keys), KEY_OFFSET_PER_PART * self._current_part
        for key, *nodes in self._parse_element_rows(block.rows, element_type):
            self._element_keys.append(key_offset + key)
            connectivity.extend(key_offset + node for node in nodes)
        count = len(self._element_keys) - start
        self._type_indices.extend([type_index] * count)
        self._record_set_named_in_block("ELSET", block, start, start + count)

    def _parse_element_rows(
        self, rows: Iterator[str], element_type: AbaqusElementType
    ) -> Iterator[list[int]]:
        """Yield, for each element, a list of its number followed by its nodes.

        An element may extend over several lines. If the element type has an unknown number of
        nodes, the list contains only the number of the element. Node numbers may be 0 in
        unsupported element types.
        """
        minimum = 1 if element_type.dim else 0
        for text in rows:
            row = parse_comma_separated_integers(text, minimum)
            if not element_type.n_nodes:
                while text.endswith(",") and (text := next(rows, "")):
                    pass
                yield row[:1]
                continue
            length = element_type.n_nodes + 1
            fits_in_line = len(row) >= length
            while len(row) < length:
                text = next(rows, "")
                if not text:
                    raise ValueError(
                        f"element {row[0]} ends after {len(row) - 1} of {element_type.n_nodes} "
                        "nodes"
                    )
                row += parse_comma_separated_integers(text, minimum)
            if len(row) > length and not fits_in_line:
                raise ValueError(
                    f"{element_type.name} has {element_type.n_nodes} nodes: the lines of element "
                    f"{row[0]} have {len(row) - 1}"
                )
            if len(row) > length:
                self._overlong_rows[element_type.name] = (
                    self._overlong_rows.get(element_type.name, 0) + 1
                )
            yield row[:length]

    def _record_set_named_in_block(
        self, set_kind: str, block: KeywordBlock, first_row: int, end_row: int
    ) -> None:
        if set_kind in block.parameters:
            self._rows_of_named_blocks[set_kind].append(
                (self._read_set_name(block, set_kind), first_row, end_row)
            )

    def _read_set_name(self, block: KeywordBlock, parameter: str) -> PartNumberAndSetName:
        name = normalize_name(block.parameters[parameter], block.location)
        if not name:
            raise KeyError(parameter)
        return self._current_part, name

    def _add_set(self, block: KeywordBlock) -> None:
        keyword, parameters = block.keyword, block.parameters
        part = (
            self._find_part_number_of_instance(
                normalize_name(parameters["INSTANCE"], block.location)
            )
            if "INSTANCE" in parameters
            else self._current_part
        )
        name = self._read_set_name(block, keyword)
        set_block = SetDefinition(name, block.location, keyword, array("q"), [], [], [])
        if keyword == "NSET" and "ELSET" in parameters:
            elements = part, normalize_name(parameters["ELSET"], block.location)
            set_block.references.append(SetReference("ELSET", elements))
        for text in block.rows:
            row_entries = split_at_unquoted_commas(text, block.location)
            if "GENERATE" in parameters:
                if len(row_entries) not in (2, 3) or not all(map(is_unsigned_integer, row_entries)):
                    raise ValueError("GENERATE takes the first number, the last, and the step")
                range_start, range_end, step = [*parse_comma_separated_integers(text), 1][:3]
                if range_end < range_start:
                    raise ValueError(
                        f"GENERATE from {range_start} to {range_end}: the last is the smaller"
                    )
                set_block.ranges.append(
                    (
                        part * KEY_OFFSET_PER_PART + range_start,
                        part * KEY_OFFSET_PER_PART + range_end,
                        step,
                    )
                )
                continue
            for member in filter(None, row_entries):
                self._add_set_member(set_block, member, part)
        self._blocks[keyword].append(set_block)

    def _add_set_member(
        self, definition: SetDefinition, number_or_set: str, part_number: int, face: str = ""
    ) -> None:
        """Add the number of a node or element, or a set's name; "INSTANCE." may precede both."""
        if not is_unsigned_integer(number_or_set):
            name = normalize_name(number_or_set, definition.location)
            instance, _, set_name = name.rpartition(".")
            if instance in self._part_of_instance:
                part_number, name = self._find_part_number_of_instance(instance), set_name
            if not is_unsigned_integer(name):
                definition.references.append(
                    SetReference(definition.set_kind, (part_number, name), face)
                )
                return
            number_or_set = name
        definition.keys.append(
            part_number * KEY_OFFSET_PER_PART + parse_comma_separated_integers(number_or_set)[0]
        )
        definition.faces.append(face)

    def _find_part_number_of_instance(self, instance: str) -> int:
        """Return the number of the part to which an instance refers."""
        if instance in self._part_of_instance:
            return self._part_of_instance[instance]
        if self.instance_names or len(self._part_numbers) > 1:
            raise ValueError(f"there is no instance {instance} before it")
        return self._current_part  # CalculiX has no instances and ignores the parameter

    def _add_surface(self, block: KeywordBlock) -> None:
        parameters = block.parameters
        name = self._read_set_name(block, "NAME")
        surface_type = normalize_name(parameters.get("TYPE", "ELEMENT"), block.location)
        if surface_type not in ("ELEMENT", "NODE"):
            self.notes.append(f"the surface {name[1]} of the type {surface_type} is left out")
            return
        set_kind = "NSET" if surface_type == "NODE" else "ELSET"
        set_block = SetDefinition(name, block.location, set_kind, array("q"), [], [], [])
        for text in block.rows:
            member, *face = split_at_unquoted_commas(text, block.location)
            face_name = (
                normalize_name(face[0], block.location) if face and set_kind == "ELSET" else ""
            )
            self._add_set_member(set_block, member, self._current_part, face_name)
        self._blocks["SURFACE"].append(set_block)

    # Tables

    def _build_node_and_element_tables(self) -> None:
        """Sort nodes and elements by their keys, and create a table of elements for each type."""
        keys = np.array(self._node_keys, dtype=np.int64)
        self.node_keys, first_rows, self._node_position = np.unique(
            keys, return_index=True, return_inverse=True
        )
        x = np.array(self._coordinates).reshape(-1, 3)
        self.x = x[first_rows]
        conflicting = np.flatnonzero((self.x[self._node_position] != x).any(axis=1))
        if len(conflicting):
            number = self.format_instance_and_number(keys[conflicting[0]])
            raise ValueError(f"{self.path}: node {number} is given twice, at two places")
        for part, offset in self._instance_offsets.items():
            start, end = np.searchsorted(
                self.node_keys, [part * KEY_OFFSET_PER_PART, (part + 1) * KEY_OFFSET_PER_PART]
            )
            self.x[start:end] += offset

        keys = np.array(self._element_keys, dtype=np.int64)
        order = np.argsort(keys, kind="stable")
        self.element_keys = keys[order]
        repeated = np.flatnonzero(np.diff(self.element_keys) == 0)
        if len(repeated):
            number = self.format_instance_and_number(self.element_keys[repeated[0]])
            raise ValueError(f"{self.path}: element {number} is given twice")
        self._element_position = np.argsort(order, kind="stable")
        self.element_types = [abaqus_element_type(name) for name in self._type_index_by_name]
        type_index = np.array(self._type_indices, dtype=np.int64)
        self.type_index = type_index[order]
        self.members = [
            self._element_position[type_index == k] for k in range(len(self.element_types))
        ]
        self.nodes = [
            np.array(nodes, dtype=np.int64).reshape(len(positions), -1)
            for nodes, positions in zip(self._connectivity, self.members, strict=True)
        ]
        self._row_in_table = np.empty(
            len(keys), dtype=np.int64
        )  # row of each element in the table of its type
        for positions in self.members:
            self._row_in_table[positions] = np.arange(len(positions))
        self._members_left = (
            BASE_LIMIT_OF_TOTAL_SET_MEMBERS
            + TOTAL_SET_MEMBER_LIMIT_PER_NODE_OR_ELEMENT * (len(self.x) + len(keys))
        )
        for name, count in self._overlong_rows.items():
            self.notes.append(
                f"{count} rows of {name} have more than {abaqus_element_type(name).n_nodes} nodes: "
                "the others are not read, as in CalculiX"
            )

    def format_instance_and_number(self, key: int) -> str:
        """Return a label of a node or element: "7", or "INSTANCE.7" if its part has an instance."""
        part, number = divmod(int(key), KEY_OFFSET_PER_PART)
        return (
            f"{self.instance_names[part]}.{number}" if part in self.instance_names else str(number)
        )

    def _spend_set_member_budget(self, n_new_members: int, location: str) -> None:
        """Count new members of sets; raise ValueError if all sets together have too many."""
        self._members_left -= n_new_members
        if self._members_left < 0:
            raise ValueError(
                f"{location}: the sets up to here have more than "
                f"{BASE_LIMIT_OF_TOTAL_SET_MEMBERS:g} members and "
                f"{TOTAL_SET_MEMBER_LIMIT_PER_NODE_OR_ELEMENT} times the nodes and elements: is a "
                "set repeated?"
            )

    # Sets

    def _resolve_set_members(self, set_kind: str) -> None:
        """Compute the positions of the nodes in all NSETs, or of the elements in all ELSETs."""
        sets = self._member_chunks[set_kind]
        are_nodes = set_kind == "NSET"
        position = self._node_position if are_nodes else self._element_position
        for name, start, end in self._rows_of_named_blocks[set_kind]:
            self._append_set_members(set_kind, name, np.unique(position[start:end]), str(self.path))
        for block, members in self._find_indices_of_listed_keys(self._blocks[set_kind]):
            sets.setdefault(block.name, [])
            chunks = [sort_distinct(members), self._find_members_in_ranges(block)]
            for reference in block.references:
                chunk = self._collect_set_members(
                    reference.set_kind, reference.name, block.location
                )
                chunks.append(
                    self._nodes_of_elements(chunk) if reference.set_kind != set_kind else chunk
                )
            for chunk in chunks:
                self._append_set_members(set_kind, block.name, chunk, block.location)
        self.sets[set_kind] = {name: self._collect_set_members(set_kind, name, "") for name in sets}

    def _append_set_members(
        self, set_kind: str, name: PartNumberAndSetName, members: Indices, location: str
    ) -> None:
        chunks = self._member_chunks[set_kind].setdefault(name, [])
        if len(members) and not (len(chunks) == 1 and members is chunks[0]):
            self._spend_set_member_budget(len(members), location)
            chunks.append(members)

    def _collect_set_members(
        self, set_kind: str, name: PartNumberAndSetName, location: str
    ) -> Indices:
        """Return the positions of all members added to a set up to now, in ascending order."""
        chunks = self._member_chunks[set_kind].get(name)
        if chunks is None:
            raise ValueError(f"{location}: the {set_kind} {name[1]} is not defined before")
        if len(chunks) != 1:
            members = np.unique(np.concatenate([np.empty(0, dtype=np.int64), *chunks]))
            self._spend_set_member_budget(sum(map(len, chunks)), location)
            chunks[:] = [members]
        return chunks[0]

    def _find_indices_of_listed_keys(
        self, definitions: list[SetDefinition]
    ) -> Iterator[tuple[SetDefinition, Indices]]:
        """Yield each block and the positions of its keys; raise ValueError for an unknown key."""
        for set_kind, existing_keys in (("NSET", self.node_keys), ("ELSET", self.element_keys)):
            selected_blocks = [block for block in definitions if block.set_kind == set_kind]
            lengths = [len(block.keys) for block in selected_blocks]
            keys = np.fromiter(
                chain.from_iterable(block.keys for block in selected_blocks), np.int64, sum(lengths)
            )
            position = np.searchsorted(existing_keys, keys)
            exists = position < len(existing_keys)
            exists[exists] = existing_keys[position[exists]] == keys[exists]
            start = 0
            for block, length in zip(selected_blocks, lengths, strict=True):
                of_block = slice(start, start + length)
                start += length
                if not exists[of_block].all():
                    number = self.format_instance_and_number(keys[of_block][~exists[of_block]][0])
                    noun = "node" if set_kind == "NSET" else "element"
                    raise ValueError(
                        f"{block.location}: {block.name[1]} has the {noun} {number}, which is not "
                        "there"
                    )
                yield block, position[of_block]

    def _find_members_in_ranges(self, definition: SetDefinition) -> Indices:
        """Return the positions of nodes or elements in a block's ranges; record sets with gaps."""
        existing_keys = self.node_keys if definition.set_kind == "NSET" else self.element_keys
        chunks = [np.empty(0, dtype=np.int64)]
        if not definition.ranges:
            return chunks[0]
        for range_start, range_end, step in merge_overlapping_ranges(definition.ranges):
            start, end = np.searchsorted(existing_keys, [range_start, range_end + 1])
            count = (range_end - range_start) // step + 1
            self._spend_set_member_budget(min(count, end - start) + 1, definition.location)
            if count < end - start:
                keys = np.arange(range_start, range_end + 1, step)
                position = start + np.searchsorted(existing_keys[start:end], keys)
                chunk = position[
                    existing_keys[np.minimum(position, len(existing_keys) - 1)] == keys
                ]
            else:
                chunk = start + np.flatnonzero((existing_keys[start:end] - range_start) % step == 0)
            if not len(chunk):
                raise ValueError(
                    f"{definition.location}: GENERATE from "
                    f"{self.format_instance_and_number(range_start)} to "
                    f"{self.format_instance_and_number(range_end)} names nothing that is there"
                )
            if len(chunk) < count:
                self._sets_with_gaps.setdefault(f"{definition.set_kind} {definition.name[1]}")
            chunks.append(chunk)
        return np.unique(np.concatenate(chunks))

    def _nodes_of_elements(self, elements: Indices) -> Indices:
        """Return the positions of all nodes of the elements at given positions."""
        keys = [np.empty(0, dtype=np.int64)]
        for type_index, nodes in enumerate(self.nodes):
            keys.append(
                nodes[self._row_in_table[elements[self.type_index[elements] == type_index]]].ravel()
            )
        return self.find_node_indices(np.unique(np.concatenate(keys)))

    def find_node_indices(self, node_keys: Indices) -> Indices:
        """Return the positions of nodes, given the keys by which elements refer to them.

        Raises:
            ValueError: if a node does not exist; the message names the one with the lowest key.
        """
        position = np.searchsorted(self.node_keys, node_keys)
        exists = position < len(self.node_keys)
        exists[exists] = self.node_keys[position[exists]] == node_keys[exists]
        if not exists.all():
            missing = self.format_instance_and_number(node_keys[~exists].min())
            raise ValueError(f"{self.path}: elements have the node {missing}, which is not there")
        return position

    def _resolve_surface_members(self) -> None:
        """Compute the parts of all surfaces."""
        for block, members in self._find_indices_of_listed_keys(self._blocks["SURFACE"]):
            surface_parts = self.surfaces.setdefault(block.name, [])
            faces = np.array(block.faces, dtype=object)
            for face in dict.fromkeys(block.faces):
                surface_parts.append(SurfaceMembers(block.set_kind, face, members[faces == face]))
            for reference in block.references:
                chunk = self._collect_set_members(
                    reference.set_kind, reference.name, block.location
                )
                self._spend_set_member_budget(len(chunk), block.location)
                surface_parts.append(SurfaceMembers(block.set_kind, reference.face, chunk))

    @property
    def used_part_numbers(self) -> Indices:
        """Numbers of the parts in use, and 0 for nodes and elements outside of parts."""
        if self.instance_names:
            return np.array([0, *self.instance_names])
        used_parts = np.unique(self.node_keys // KEY_OFFSET_PER_PART)
        if len(used_parts[used_parts > 0]) > 1:
            names = [
                name
                for name, part in self._part_numbers.items()
                if part in used_parts[used_parts > 0]
            ]
            raise ValueError(f"{self.path}: the parts {', '.join(names)} are in no instance")
        return np.union1d(used_parts, 0)


def sort_distinct(members: Indices) -> Indices:
    """Return the distinct values of an array in ascending order."""
    return np.unique(members) if len(members) > 1 else members


def merge_overlapping_ranges(ranges: list[tuple[int, int, int]]) -> list[tuple[int, int, int]]:
    """Merge overlapping ranges (first, last, step) with equal steps and equal remainders."""
    by_phase: dict[tuple[int, int], list[tuple[int, int]]] = {}
    for range_start, range_end, step in set(ranges):
        by_phase.setdefault((step, range_start % step), []).append((range_start, range_end))
    merged_ranges = []
    for (step, _), spans in by_phase.items():
        spans.sort()
        start, end = spans[0]
        for range_start, range_end in spans:
            if range_start > end + step:
                merged_ranges.append((start, end, step))
                start, end = range_start, range_end
            end = max(end, range_end)
        merged_ranges.append((start, end, step))
    return merged_ranges
