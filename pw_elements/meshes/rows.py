"""Readers of the rows of numbers in a section of a Gmsh file, text or binary.

A number of rows is accepted only if the section has enough bytes for it. Integers have one of two
format letters: "i" for 4 bytes, or "q" for as many bytes as the file uses for counts. In text files
the letters have no effect.
"""

import re
import struct
from collections.abc import Iterator
from typing import Protocol

import numpy as np
import numpy.typing as npt

from pw_elements.arrays import Array, Indices
from pw_elements.meshes.elements import gmsh_element_type

_INTEGER_PATTERN = re.compile(r"[+-]?\d{1,18}")
# Limit of integers that are exact when a row is read as floating-point numbers
_MAX_INTEGER_EXACT_AS_FLOAT = 2**53


class SectionRowReader(Protocol):
    """Sequential reader of the rows of a section."""

    def read_count(self) -> int:
        """Read a row that contains a single count; this row is text, even in binary files."""

    def read_integers(self, format_letters: str) -> list[int]:
        """Read a row of integers, one for each format letter."""

    def read_entity_number_and_groups(
        self, n_skipped_coordinates: int, has_bounding_entities: bool
    ) -> tuple[int, tuple[int, ...]]:
        """Read the number of an entity and its physical groups.

        Args:
            n_skipped_coordinates: number of coordinates in the row, which are skipped.
            has_bounding_entities: whether the row lists bounding entities, which are skipped.
        """

    def read_table(
        self, n_rows: int, integer_format: str, n_integers: int, n_floats: int
    ) -> tuple[Indices, Array]:
        """Read rows that consist of integers followed by floats.

        Args:
            n_rows: number of rows.
            integer_format: format letter of the integers.
            n_integers: number of integers in a row.
            n_floats: number of floats in a row.

        Returns:
            Integers (n_rows, n_integers) and floats (n_rows, n_floats).
        """

    def read_format_2_elements_by_type(self, n_elements: int) -> Iterator[tuple[int, int, Indices]]:
        """Yield the elements of a file of format 2 in blocks of one type and number of tags.

        Yields:
            Number of the element type; number of tags of each element; and rows that contain the
            number, the tags and the nodes of each element.
        """

    def check_all_rows_read(self) -> None:
        """Raise ValueError if the section has rows that were not read."""


class TextRowReader:
    """Reader of rows that are lines of text; implements `SectionRowReader`."""

    def __init__(self, section: bytes) -> None:
        try:
            text = section.decode("ascii")
        except UnicodeDecodeError as error:
            raise ValueError(f"byte {section[error.start]} stands among the numbers") from error
        self._lines = [line for line in text.split("\n") if line and not line.isspace()]
        self._position = 0

    def read_count(self) -> int:
        return self.read_integers("q")[0]

    def read_integers(self, format_letters: str) -> list[int]:
        (line,) = self._take_next_lines(1)
        words = line.split()
        if len(words) != len(format_letters):
            raise ValueError(
                f"row '{_shorten_for_message(line)}' has to have {len(format_letters)} numbers"
            )
        return [_parse_integer(word) for word in words]

    def read_entity_number_and_groups(
        self, n_skipped_coordinates: int, has_bounding_entities: bool
    ) -> tuple[int, tuple[int, ...]]:
        (line,) = self._take_next_lines(1)
        words = line.split()
        groups, remainder = _parse_counted_integer_list(words[1 + n_skipped_coordinates :])
        if has_bounding_entities:
            _, remainder = _parse_counted_integer_list(remainder)
        if remainder:
            raise ValueError(
                f"entity '{_shorten_for_message(line)}' has more numbers than it states"
            )
        return _parse_integer(words[0]), tuple(groups)

    def read_table(
        self,
        n_rows: int,
        integer_format: str,  # noqa: ARG002
        n_integers: int,
        n_floats: int,
    ) -> tuple[Indices, Array]:
        return _parse_rows(self._take_next_lines(n_rows), n_integers, n_floats)

    def read_format_2_elements_by_type(self, n_elements: int) -> Iterator[tuple[int, int, Indices]]:
        lines_of_type: dict[tuple[int, int], list[str]] = {}
        for line in self._take_next_lines(n_elements):
            words = line.split(None, 3)
            if len(words) < 4:
                raise ValueError(f"element '{_shorten_for_message(line)}' has too few numbers")
            lines_of_type.setdefault(
                (_parse_integer(words[1]), _parse_integer(words[2])), []
            ).append(line)
        for (type_number, n_tags), lines in lines_of_type.items():
            if n_tags < 0:
                raise ValueError(f"element '{_shorten_for_message(lines[0])}' has {n_tags} tags")
            rows, _ = _parse_rows(lines, 3 + n_tags + gmsh_element_type(type_number).n_nodes, 0)
            yield type_number, n_tags, np.delete(rows, [1, 2], axis=1)

    def check_all_rows_read(self) -> None:
        if self._position < len(self._lines):
            raise ValueError(
                f"{len(self._lines) - self._position} more rows are there than it states"
            )

    def _take_next_lines(self, n_lines: int) -> list[str]:
        n_left = len(self._lines) - self._position
        if not 0 <= n_lines <= n_left:
            raise ValueError(f"it states {n_lines} more rows, but has {n_left}")
        self._position += n_lines
        return self._lines[self._position - n_lines : self._position]


class BinaryRowReader:
    """Reader of binary rows; implements `SectionRowReader`.

    Args:
        section: content of the section.
        order: byte order, "<" for little-endian or ">" for big-endian.
        count_letter: type of the file's counts as a letter of the module `struct`, "i" or "q".
    """

    def __init__(self, section: bytes, order: str, count_letter: str) -> None:
        self._data, self._byte_order, self._count_letter = section, order, count_letter
        self._position = 0

    def read_count(self) -> int:
        end = self._data.find(b"\n", self._position, self._position + 30)
        text = self._data[self._position : max(end, self._position)].decode("ascii", "replace")
        self._position = end + 1
        return _parse_integer(text.strip())

    def read_integers(self, format_letters: str) -> list[int]:
        layout = self._byte_order + format_letters.replace("q", self._count_letter)
        start = self._skip_rows_and_return_start(1, struct.calcsize(layout))
        return [*struct.unpack_from(layout, self._data, start)]

    def read_entity_number_and_groups(
        self, n_skipped_coordinates: int, has_bounding_entities: bool
    ) -> tuple[int, tuple[int, ...]]:
        (number,) = self.read_integers("i")
        self._skip_rows_and_return_start(n_skipped_coordinates, 8)
        groups = self._read_counted_integer_list()
        if has_bounding_entities:
            self._read_counted_integer_list()
        return number, groups

    def read_table(
        self, n_rows: int, integer_format: str, n_integers: int, n_floats: int
    ) -> tuple[Indices, Array]:
        size = 8 if integer_format.replace("q", self._count_letter) == "q" else 4
        start = self._skip_rows_and_return_start(n_rows, n_integers * size + n_floats * 8)
        integer_type, float_type = f"{self._byte_order}i{size}", f"{self._byte_order}f8"
        row_type = np.dtype(
            [("integers", integer_type, (n_integers,)), ("floats", float_type, (n_floats,))]
        )
        rows = np.frombuffer(self._data, row_type, n_rows, start)
        return rows["integers"].astype(np.int64), rows["floats"].astype(np.float64)

    def read_format_2_elements_by_type(self, n_elements: int) -> Iterator[tuple[int, int, Indices]]:
        while n_elements > 0:
            type_number, n_in_block, n_tags = self.read_integers("iii")
            if not 0 < n_in_block <= n_elements or n_tags < 0:
                raise ValueError(f"a block states {n_in_block} elements with {n_tags} tags each")
            yield (
                type_number,
                n_tags,
                self.read_table(
                    n_in_block, "i", 1 + n_tags + gmsh_element_type(type_number).n_nodes, 0
                )[0],
            )
            n_elements -= n_in_block

    def check_all_rows_read(self) -> None:
        if remainder := self._data[self._position :].strip():
            raise ValueError(f"{len(remainder)} more bytes are there than it states")

    def _read_counted_integer_list(self) -> tuple[int, ...]:
        (count,) = self.read_integers("q")
        start = self._skip_rows_and_return_start(count, 4)
        return struct.unpack_from(f"{self._byte_order}{count}i", self._data, start)

    def _skip_rows_and_return_start(self, n_rows: int, bytes_per_row: int) -> int:
        n_left = len(self._data) - self._position
        if n_rows < 0 or n_rows * bytes_per_row > n_left:
            raise ValueError(
                f"it states {n_rows} more rows of {bytes_per_row} bytes, but has {n_left} bytes"
            )
        self._position += n_rows * bytes_per_row
        return self._position - n_rows * bytes_per_row


def _parse_integer(word: str) -> int:
    if not _INTEGER_PATTERN.fullmatch(word):
        raise ValueError(f"'{_shorten_for_message(word)}' is no integer of at most 18 digits")
    return int(word)


def _shorten_for_message(line: str) -> str:
    line = " ".join(line.split())
    return line if len(line) <= 60 else line[:57] + "..."


def _parse_counted_integer_list(words: list[str]) -> tuple[list[int], list[str]]:
    """Parse a list of integers that begins with its length.

    Returns:
        The integers, and the words after the list.
    """
    count = _parse_integer(words[0]) if words else -1
    if not 0 <= count < len(words):
        raise ValueError("an entity has fewer numbers than it states")
    return [_parse_integer(word) for word in words[1 : 1 + count]], words[1 + count :]


def _parse_rows(lines: list[str], n_integers: int, n_floats: int) -> tuple[Indices, Array]:
    """Parse n lines that consist of integers followed by floats.

    Returns:
        Integers (n, n_integers) and floats (n, n_floats).
    """
    n_columns = n_integers + n_floats
    if not lines:
        return np.empty((0, n_integers), dtype=np.int64), np.empty((0, n_floats))
    for line in lines:
        if len(line.split()) != n_columns:
            raise ValueError(f"row '{_shorten_for_message(line)}' has to have {n_columns} numbers")
    numbers: npt.NDArray[np.float64 | np.int64]
    try:
        number_type = np.float64 if n_floats else np.int64
        numbers = np.fromstring(" ".join(lines), number_type, sep=" ")
    except (ValueError, DeprecationWarning):
        numbers = np.empty(0)
    if numbers.size != len(lines) * n_columns:
        raise ValueError(_describe_first_wrong_word(lines, n_integers))
    numbers = numbers.reshape(-1, n_columns)
    integers = numbers[:, :n_integers]
    if n_floats:
        is_wrong = ~(np.abs(integers) < _MAX_INTEGER_EXACT_AS_FLOAT) | (integers % 1 != 0)
    else:
        is_wrong = np.abs(integers) >= np.iinfo(np.int64).max
    if is_wrong.any():
        line = lines[int(np.flatnonzero(is_wrong.any(axis=1))[0])]
        raise ValueError(
            f"row '{_shorten_for_message(line)}' has a number of a node that is no such number"
        )
    return integers.astype(np.int64), numbers[:, n_integers:].astype(np.float64)


def _describe_first_wrong_word(lines: list[str], n_integers: int) -> str:
    """Return an error message that names the first word that is not the number it has to be."""
    for line in lines:
        for column, word in enumerate(line.split()):
            pattern = r"[+-]?\d+" if column < n_integers else r"[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?"
            if not re.fullmatch(pattern, word, re.IGNORECASE):
                expected = "integer" if column < n_integers else "number"
                place = f"'{_shorten_for_message(word)}' in row '{_shorten_for_message(line)}'"
                return f"{place} is no {expected}"
    return "its rows are no numbers"
