"""Model of one of Abaqus' input files: nodes, elements, and sets of them, as tables.

What follows the model, from *STEP on, is not read. Whatever the order of the text, nodes and
elements are read first, then ELSETs, NSETs and SURFACEs, as CalculiX does.
"""

from array import array
from collections.abc import Iterator
from itertools import chain
from pathlib import Path
from typing import NamedTuple

import numpy as np

from pw_elements.abaqus.lines import (
    Block,
    PlacedError,
    coordinates,
    entries,
    integers,
    is_number,
    label,
    read_blocks,
)
from pw_elements.abaqus.types import Kind, kind_of
from pw_elements.arrays import Indices
from pw_elements.checks import arguments

# Keywords that make nodes or elements, or move them
NOT_READ = {"NGEN", "NFILL", "NCOPY", "NMAP", "ELGEN", "ELCOPY", "SYSTEM", "IMPORT"}
NOT_READ |= {"SYMMETRICMODELGENERATION", "MESHREFINEMENT", "SUBSTRUCTUREGENERATE"}
# Parameters that are read, or that do not change nodes and members
PARAMETERS = {
    "NODE": {"NSET", "SYSTEM", "INTERNAL"},
    "ELEMENT": {"TYPE", "ELSET", "PARENT", "DLOAD", "SOLIDELEMENTNUMBERING", "INTERNAL"},
    "NSET": {"NSET", "GENERATE", "ELSET", "INSTANCE", "INTERNAL", "UNSORTED", "FREQUENCY"},
    "ELSET": {"ELSET", "GENERATE", "INSTANCE", "INTERNAL", "UNSORTED"},
    "SURFACE": {"NAME", "TYPE", "INTERNAL", "TRIM", "PROPERTY", "NOTHICK", "NOOFFSET"},
}
KEYWORDS = NOT_READ | PARAMETERS.keys() | {"PART", "ENDPART", "INSTANCE", "ENDINSTANCE", "STEP"}
# A key is a number of a node or element and this times the number of its part
PART = 2**32
MAX_TYPES = 1000
# Members that all sets may have together, and entries that ranges may be compared with: so many,
# and so many times the nodes and elements
MAX_MEMBERS, MAX_MEMBERSHIPS = 2_000_000, 20

Name = tuple[int, str]  # number of the part, and the name in it


class Reference(NamedTuple):
    """A set that is named in a row of another, and the face of its elements ("" if none is)."""

    sort: str
    name: Name
    face: str = ""


class SetBlock(NamedTuple):
    """Rows of one block: keys of nodes or elements, ranges of keys, and other sets.

    Args:
        name: of the set.
        place: of the block.
        sort: "NSET" if its numbers are those of nodes, else "ELSET".
        keys: of members (n,).
        faces: of a surface, one for each key.
        ranges: first key, last key, step.
        references: to sets.
    """

    name: Name
    place: str
    sort: str
    keys: array
    faces: list[str]
    ranges: list[tuple[int, int, int]]
    references: list[Reference]


class SurfacePart(NamedTuple):
    """Positions of elements ("ELSET") and one face of them ("" for all free ones), or of nodes."""

    sort: str
    face: str
    members: Indices


class Deck:
    """Nodes and elements of a file, sets of their positions, and surfaces.

    Attributes:
        node_keys: of the nodes (n,), in ascending order.
        x: coordinates (n, 3).
        element_keys: of the elements (m,), in ascending order; those that are not read, too.
        kinds: types of elements.
        kind: number of the type of each element (m,).
        members: by type, positions of its elements in the order of the file.
        nodes: by type, keys (elements of it, nodes) of their nodes.
        sets: of "NSET" and "ELSET": positions of nodes or elements, in ascending order.
        surfaces: parts of each.
        instances: name of the instance of each part that is in one.
        notes: sentences on what was left out, or taken in another way than written.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.instances: dict[int, str] = {}
        self._part_of_instance: dict[str, int] = {}
        self.notes: list[str] = []
        self.sets: dict[str, dict[Name, Indices]] = {}
        self.surfaces: dict[Name, list[SurfacePart]] = {}
        self._parts, self._part = {"": 0}, 0
        self._shifts: dict[int, list[float]] = {}
        self._node_keys, self._x = array("q"), array("d")
        self._types: dict[str, int] = {}
        self._element_keys, self._kind = array("q"), array("q")
        self._connectivity: list[array] = []
        self._longer: dict[str, int] = {}
        self._blocks: dict[str, list[SetBlock]] = {"NSET": [], "ELSET": [], "SURFACE": []}
        # sets that blocks of nodes and elements name: rows of those, from the first to the end
        self._named_rows: dict[str, list[tuple[Name, int, int]]] = {"NSET": [], "ELSET": []}
        self._chunks: dict[str, dict[Name, list[Indices]]] = {"NSET": {}, "ELSET": {}}
        self._with_gaps: dict[str, None] = {}
        for block in read_blocks(path, KEYWORDS):
            if block.keyword == "STEP":
                break
            try:
                self._add(block)
            except KeyError as error:
                raise ValueError(f"{block.place}: {error.args[0]}=... is missing") from error
            except PlacedError:
                raise
            except ValueError as error:
                raise ValueError(f"{block.here()}, *{block.keyword}: {error}") from error
        self._finish_tables()
        self._resolve_sets("ELSET")
        self._resolve_sets("NSET")
        self._resolve_surfaces()
        if self._with_gaps:
            first, *others = self._with_gaps
            more = f" and {len(others)} other sets" if others else ""
            self.notes.append(f"ranges of {first}{more} have numbers of nothing that is there")

    # Reading

    def _add(self, block: Block) -> None:
        keyword, given = block.keyword, block.parameters
        if keyword in NOT_READ:
            raise ValueError("this is not read: write all nodes and elements out, in x, y, z")
        if unknown := given.keys() - PARAMETERS.get(keyword, given.keys()):
            raise ValueError(f"the parameter {min(unknown)} is not read")
        match keyword:
            case "PART":
                self._part = self._new_part(label(given["NAME"], block.place))
            case "INSTANCE":
                self._add_instance(block)
            case "ENDPART" | "ENDINSTANCE":
                self._part = 0
            case "NODE":
                self._add_nodes(block)
            case "ELEMENT":
                self._add_elements(block)
            case "NSET" | "ELSET":
                self._add_set(block)
            case "SURFACE":
                self._add_surface(block)

    def _new_part(self, name: str) -> int:
        if name in self._parts:
            raise ValueError(f"the part {name} is given twice")
        return self._parts.setdefault(name, len(self._parts))

    def _add_instance(self, block: Block) -> None:
        name, part = (label(block.parameters[key], block.place) for key in ("NAME", "PART"))
        rows = [text.split(",") for text in block.rows]
        number = self._parts.get(part, -1)
        if name in self._part_of_instance:
            raise ValueError(f"the instance {name} is given twice")
        if number < 1:
            raise ValueError(f"{name}: there is no part {part} before it")
        if number in self.instances or len(rows) > 1 or len(rows[:1] and rows[0]) > 4:
            raise ValueError(f"{name}: parts that are turned, or used twice, are not read")
        self.instances[number] = name
        self._part_of_instance[name] = number
        self._part = number  # nodes and elements may stand in the instance, too
        shift = ",".join(["1", *rows[0]]) if rows else "1"
        self._shifts[number] = coordinates(shift)[1]

    def _add_nodes(self, block: Block) -> None:
        if block.parameters.get("SYSTEM", "R").upper() != "R":
            raise ValueError("SYSTEM is not read: write the nodes in x, y, z")
        if any(self._shifts.get(self._part, ())):
            raise ValueError("nodes in an instance that is moved are not read")
        first, base = len(self._node_keys), PART * self._part
        for text in block.rows:
            number, x = coordinates(text)
            self._node_keys.append(base + number)
            self._x.extend(x)
        self._name_rows("NSET", block, first, len(self._node_keys))
        size = max(map(abs, self._x[3 * first :]), default=0.0)
        if not size <= arguments.MAX_MAGNITUDE:
            raise ValueError(
                f"a coordinate is of the size {size:.3g}, larger than {arguments.MAX_MAGNITUDE:g}"
            )

    def _add_elements(self, block: Block) -> None:
        name = label(block.parameters["TYPE"], block.place)
        kind = kind_of(name)
        number = self._types.setdefault(name, len(self._types))
        if number >= MAX_TYPES:
            raise ValueError(f"there are more than {MAX_TYPES} types of elements")
        if number == len(self._connectivity):
            self._connectivity.append(array("q"))
        connectivity = self._connectivity[number]
        first, base = len(self._element_keys), PART * self._part
        for key, *nodes in self._element_rows(block.rows, kind):
            self._element_keys.append(base + key)
            connectivity.extend(base + node for node in nodes)
        count = len(self._element_keys) - first
        self._kind.extend([number] * count)
        self._name_rows("ELSET", block, first, first + count)

    def _element_rows(self, rows: Iterator[str], kind: Kind) -> Iterator[list[int]]:
        """Yield number and nodes of elements, whose rows may go on over several lines.

        Only the number is read of elements that are no cells; their nodes may be 0.
        """
        least = 1 if kind.dim else 0
        for text in rows:
            row = integers(text, least)
            if not kind.nodes:
                while text.endswith(",") and (text := next(rows, "")):
                    pass
                yield row[:1]
                continue
            length = kind.nodes + 1
            one_line = len(row) >= length
            while len(row) < length:
                text = next(rows, "")
                if not text:
                    raise ValueError(
                        f"element {row[0]} ends after {len(row) - 1} of {kind.nodes} nodes"
                    )
                row += integers(text, least)
            if len(row) > length and not one_line:
                raise ValueError(
                    f"{kind.name} has {kind.nodes} nodes: the lines of element {row[0]} have "
                    f"{len(row) - 1}"
                )
            if len(row) > length:
                self._longer[kind.name] = self._longer.get(kind.name, 0) + 1
            yield row[:length]

    def _name_rows(self, sort: str, block: Block, first: int, end: int) -> None:
        if sort in block.parameters:
            self._named_rows[sort].append((self._name(block, sort), first, end))

    def _name(self, block: Block, key: str) -> Name:
        name = label(block.parameters[key], block.place)
        if not name:
            raise KeyError(key)
        return self._part, name

    def _add_set(self, block: Block) -> None:
        keyword, given = block.keyword, block.parameters
        part = (
            self._part_of(label(given["INSTANCE"], block.place))
            if "INSTANCE" in given
            else self._part
        )
        name = self._name(block, keyword)
        added = SetBlock(name, block.place, keyword, array("q"), [], [], [])
        if keyword == "NSET" and "ELSET" in given:
            elements = part, label(given["ELSET"], block.place)
            added.references.append(Reference("ELSET", elements))
        for text in block.rows:
            row = entries(text, block.place)
            if "GENERATE" in given:
                if len(row) not in (2, 3) or not all(map(is_number, row)):
                    raise ValueError("GENERATE takes the first number, the last, and the step")
                first, last, step = [*integers(text), 1][:3]
                if last < first:
                    raise ValueError(f"GENERATE from {first} to {last}: the last is the smaller")
                added.ranges.append((part * PART + first, part * PART + last, step))
                continue
            for entry in filter(None, row):
                self._add_member(added, entry, part)
        self._blocks[keyword].append(added)

    def _add_member(self, block: SetBlock, entry: str, part: int, face: str = "") -> None:
        """Add a number or a set's name, either of which may stand after the name of an instance."""
        if not is_number(entry):
            name = label(entry, block.place)
            instance, _, rest = name.rpartition(".")
            if instance in self._part_of_instance:
                part, name = self._part_of(instance), rest
            if not is_number(name):
                block.references.append(Reference(block.sort, (part, name), face))
                return
            entry = name
        block.keys.append(part * PART + integers(entry)[0])
        block.faces.append(face)

    def _part_of(self, instance: str) -> int:
        if instance in self._part_of_instance:
            return self._part_of_instance[instance]
        if self.instances or len(self._parts) > 1:
            raise ValueError(f"there is no instance {instance} before it")
        return self._part  # CalculiX knows no instances, and passes the parameter by

    def _add_surface(self, block: Block) -> None:
        given = block.parameters
        name = self._name(block, "NAME")
        kind = label(given.get("TYPE", "ELEMENT"), block.place)
        if kind not in ("ELEMENT", "NODE"):
            self.notes.append(f"the surface {name[1]} of the type {kind} is left out")
            return
        sort = "NSET" if kind == "NODE" else "ELSET"
        added = SetBlock(name, block.place, sort, array("q"), [], [], [])
        for text in block.rows:
            member, *face = entries(text, block.place)
            side = label(face[0], block.place) if face and sort == "ELSET" else ""
            self._add_member(added, member, self._part, side)
        self._blocks["SURFACE"].append(added)

    # Tables of what was read

    def _finish_tables(self) -> None:
        """Sort nodes and elements by their keys."""
        keys = np.array(self._node_keys, dtype=np.int64)
        self.node_keys, rows, self._node_position = np.unique(
            keys, return_index=True, return_inverse=True
        )
        x = np.array(self._x).reshape(-1, 3)
        self.x = x[rows]
        moved = np.flatnonzero((self.x[self._node_position] != x).any(axis=1))
        if len(moved):
            number = self.number(keys[moved[0]])
            raise ValueError(f"{self.path}: node {number} is given twice, at two places")
        for part, shift in self._shifts.items():
            first, end = np.searchsorted(self.node_keys, [part * PART, (part + 1) * PART])
            self.x[first:end] += shift

        keys = np.array(self._element_keys, dtype=np.int64)
        order = np.argsort(keys, kind="stable")
        self.element_keys = keys[order]
        twice = np.flatnonzero(np.diff(self.element_keys) == 0)
        if len(twice):
            number = self.number(self.element_keys[twice[0]])
            raise ValueError(f"{self.path}: element {number} is given twice")
        self._element_position = np.argsort(order, kind="stable")
        self.kinds = [kind_of(name) for name in self._types]
        kind = np.array(self._kind, dtype=np.int64)
        self.kind = kind[order]
        self.members = [self._element_position[kind == k] for k in range(len(self.kinds))]
        self.nodes = [
            np.array(nodes, dtype=np.int64).reshape(len(members), -1)
            for nodes, members in zip(self._connectivity, self.members, strict=True)
        ]
        self._row = np.empty(len(keys), dtype=np.int64)  # of each element in its own table
        for members in self.members:
            self._row[members] = np.arange(len(members))
        self._allowed = MAX_MEMBERS + MAX_MEMBERSHIPS * (len(self.x) + len(keys))
        for name, count in self._longer.items():
            self.notes.append(
                f"{count} rows of {name} have more than {kind_of(name).nodes} nodes: the others "
                "are not read, as in CalculiX"
            )

    def number(self, key: int) -> str:
        """Return the number of a node or an element as it is written, after its instance if any."""
        part, number = divmod(int(key), PART)
        return f"{self.instances[part]}.{number}" if part in self.instances else str(number)

    def _spend(self, count: int, place: str) -> None:
        """Refuse sets whose members, taken together, are out of proportion to the mesh."""
        self._allowed -= count
        if self._allowed < 0:
            raise ValueError(
                f"{place}: the sets up to here have more than {MAX_MEMBERS:g} members and "
                f"{MAX_MEMBERSHIPS} times the nodes and elements: is a set repeated?"
            )

    # Sets

    def _resolve_sets(self, sort: str) -> None:
        sets = self._chunks[sort]
        nodes = sort == "NSET"
        position = self._node_position if nodes else self._element_position
        for name, first, end in self._named_rows[sort]:
            self._extend(sort, name, np.unique(position[first:end]), str(self.path))
        for block, members in self._with_positions(self._blocks[sort]):
            sets.setdefault(block.name, [])
            chunks = [unique(members), self._range_members(block)]
            for reference in block.references:
                chunk = self._set(reference.sort, reference.name, block.place)
                chunks.append(self._nodes_of(chunk) if reference.sort != sort else chunk)
            for chunk in chunks:
                self._extend(sort, block.name, chunk, block.place)
        self.sets[sort] = {name: self._set(sort, name, "") for name in sets}

    def _extend(self, sort: str, name: Name, members: Indices, place: str) -> None:
        chunks = self._chunks[sort].setdefault(name, [])
        if len(members) and not (len(chunks) == 1 and members is chunks[0]):
            self._spend(len(members), place)
            chunks.append(members)

    def _set(self, sort: str, name: Name, place: str) -> Indices:
        chunks = self._chunks[sort].get(name)
        if chunks is None:
            raise ValueError(f"{place}: the {sort} {name[1]} is not defined before")
        if len(chunks) != 1:
            members = np.unique(np.concatenate([np.empty(0, dtype=np.int64), *chunks]))
            self._spend(sum(map(len, chunks)), place)
            chunks[:] = [members]
        return chunks[0]

    def _with_positions(self, blocks: list[SetBlock]) -> Iterator[tuple[SetBlock, Indices]]:
        """Yield blocks with the positions of their keys, which have to be there."""
        for sort, known in (("NSET", self.node_keys), ("ELSET", self.element_keys)):
            own = [block for block in blocks if block.sort == sort]
            lengths = [len(block.keys) for block in own]
            keys = np.fromiter(
                chain.from_iterable(block.keys for block in own), np.int64, sum(lengths)
            )
            position = np.searchsorted(known, keys)
            there = position < len(known)
            there[there] = known[position[there]] == keys[there]
            start = 0
            for block, length in zip(own, lengths, strict=True):
                part = slice(start, start + length)
                start += length
                if not there[part].all():
                    number = self.number(keys[part][~there[part]][0])
                    noun = "node" if sort == "NSET" else "element"
                    raise ValueError(
                        f"{block.place}: {block.name[1]} has the {noun} {number}, which is not "
                        "there"
                    )
                yield block, position[part]

    def _range_members(self, block: SetBlock) -> Indices:
        """Positions of the nodes or elements in ranges of keys; numbers without one are noted."""
        known = self.node_keys if block.sort == "NSET" else self.element_keys
        chunks = [np.empty(0, dtype=np.int64)]
        if not block.ranges:
            return chunks[0]
        for first, last, step in merged(block.ranges):
            start, end = np.searchsorted(known, [first, last + 1])
            count = (last - first) // step + 1
            self._spend(min(count, end - start) + 1, block.place)
            if count < end - start:
                keys = np.arange(first, last + 1, step)
                position = start + np.searchsorted(known[start:end], keys)
                chunk = position[known[np.minimum(position, len(known) - 1)] == keys]
            else:
                chunk = start + np.flatnonzero((known[start:end] - first) % step == 0)
            if not len(chunk):
                raise ValueError(
                    f"{block.place}: GENERATE from {self.number(first)} to {self.number(last)} "
                    "names nothing that is there"
                )
            if len(chunk) < count:
                self._with_gaps.setdefault(f"{block.sort} {block.name[1]}")
            chunks.append(chunk)
        return np.unique(np.concatenate(chunks))

    def _nodes_of(self, elements: Indices) -> Indices:
        """Positions of the nodes of elements."""
        keys = [np.empty(0, dtype=np.int64)]
        for k, nodes in enumerate(self.nodes):
            keys.append(nodes[self._row[elements[self.kind[elements] == k]]].ravel())
        return self.node_positions(np.unique(np.concatenate(keys)))

    def node_positions(self, keys: Indices) -> Indices:
        """Return the positions of nodes, which elements name.

        Raises:
            ValueError: for the first node that is not there.
        """
        position = np.searchsorted(self.node_keys, keys)
        there = position < len(self.node_keys)
        there[there] = self.node_keys[position[there]] == keys[there]
        if not there.all():
            lost = self.number(keys[~there].min())
            raise ValueError(f"{self.path}: elements have the node {lost}, which is not there")
        return position

    def _resolve_surfaces(self) -> None:
        for block, members in self._with_positions(self._blocks["SURFACE"]):
            parts = self.surfaces.setdefault(block.name, [])
            faces = np.array(block.faces, dtype=object)
            for face in dict.fromkeys(block.faces):
                parts.append(SurfacePart(block.sort, face, members[faces == face]))
            for reference in block.references:
                chunk = self._set(reference.sort, reference.name, block.place)
                self._spend(len(chunk), block.place)
                parts.append(SurfacePart(block.sort, reference.face, chunk))

    @property
    def placed(self) -> Indices:
        """Numbers of the parts that the model consists of."""
        if self.instances:
            return np.array([0, *self.instances])
        parts = np.unique(self.node_keys // PART)
        if len(parts[parts > 0]) > 1:
            names = [name for name, part in self._parts.items() if part in parts[parts > 0]]
            raise ValueError(f"{self.path}: the parts {', '.join(names)} are in no instance")
        return np.union1d(parts, 0)


def unique(members: Indices) -> Indices:
    """Return members in ascending order, each once; quick where there is but one."""
    return np.unique(members) if len(members) > 1 else members


def merged(ranges: list[tuple[int, int, int]]) -> list[tuple[int, int, int]]:
    """Join ranges (first, last, step) of the same numbers, so that none is walked over twice."""
    by_phase: dict[tuple[int, int], list[tuple[int, int]]] = {}
    for first, last, step in set(ranges):
        by_phase.setdefault((step, first % step), []).append((first, last))
    joined = []
    for (step, _), spans in by_phase.items():
        spans.sort()
        start, end = spans[0]
        for first, last in spans:
            if first > end + step:
                joined.append((start, end, step))
                start, end = first, last
            end = max(end, last)
        joined.append((start, end, step))
    return joined
