"""Rows of numbers in a section of a Gmsh file, as text and in binary.

A count is believed only as far as the section has bytes for it. Both classes have the same methods;
letters for integers are "i" (4 bytes in binary) and "q" (as long as the file's counts).
"""

import re
import struct
from collections.abc import Iterator
from typing import Protocol

import numpy as np
import numpy.typing as npt

from pw_elements.arrays import Array, Indices
from pw_elements.meshes.elements import kind_of

_INTEGER = re.compile(r"[+-]?\d{1,18}")
# Integers up to this one are exact when a row is read in floating point, with its coordinates
_MAX_EXACT = 2**53


class Rows(Protocol):
    """Methods by which a section is read from its beginning to its end."""

    def count(self) -> int:
        """Read a row with one number, which is text in binary files, too."""

    def integers(self, letters: str) -> list[int]:
        """Read a row of integers, one for each letter."""

    def entity(self, n_coordinates: int, bounded: bool) -> tuple[int, tuple[int, ...]]:
        """Read an entity's number and physical groups; its coordinates and bounds are left out."""

    def table(
        self, n_rows: int, letter: str, n_integers: int, n_floats: int
    ) -> tuple[Indices, Array]:
        """Read rows of integers (n_rows, n_integers) that numbers (n_rows, n_floats) follow."""

    def tagged_elements(self, n_rows: int) -> Iterator[tuple[int, int, Indices]]:
        """Read elements of format 2: type, number of tags, rows of number, tags and nodes."""

    def finish(self) -> None:
        """Raise ValueError if the section has not been read to its end."""


class TextRows:
    """Rows that are lines of text, as `Rows` has them."""

    def __init__(self, section: bytes) -> None:
        try:
            text = section.decode("ascii")
        except UnicodeDecodeError as error:
            raise ValueError(f"byte {section[error.start]} stands among the numbers") from error
        self._lines = [line for line in text.split("\n") if line and not line.isspace()]
        self._next = 0

    def count(self) -> int:
        return self.integers("q")[0]

    def integers(self, letters: str) -> list[int]:
        (line,) = self._take(1)
        words = line.split()
        if len(words) != len(letters):
            raise ValueError(f"row '{_short(line)}' has to have {len(letters)} numbers")
        return [_integer(word) for word in words]

    def entity(self, n_coordinates: int, bounded: bool) -> tuple[int, tuple[int, ...]]:
        (line,) = self._take(1)
        words = line.split()
        groups, rest = _split_list(words[1 + n_coordinates :])
        if bounded:
            _, rest = _split_list(rest)
        if rest:
            raise ValueError(f"entity '{_short(line)}' has more numbers than it states")
        return _integer(words[0]), tuple(groups)

    def table(
        self,
        n_rows: int,
        letter: str,  # noqa: ARG002
        n_integers: int,
        n_floats: int,
    ) -> tuple[Indices, Array]:
        return _parse(self._take(n_rows), n_integers, n_floats)

    def tagged_elements(self, n_rows: int) -> Iterator[tuple[int, int, Indices]]:
        lines_of: dict[tuple[int, int], list[str]] = {}
        for line in self._take(n_rows):
            words = line.split(None, 3)
            if len(words) < 4:
                raise ValueError(f"element '{_short(line)}' has too few numbers")
            lines_of.setdefault((_integer(words[1]), _integer(words[2])), []).append(line)
        for (kind, n_tags), lines in lines_of.items():
            if n_tags < 0:
                raise ValueError(f"element '{_short(lines[0])}' has {n_tags} tags")
            rows, _ = _parse(lines, 3 + n_tags + kind_of(kind).n_nodes, 0)
            yield kind, n_tags, np.delete(rows, [1, 2], axis=1)

    def finish(self) -> None:
        if self._next < len(self._lines):
            raise ValueError(f"{len(self._lines) - self._next} more rows are there than it states")

    def _take(self, n_rows: int) -> list[str]:
        left = len(self._lines) - self._next
        if not 0 <= n_rows <= left:
            raise ValueError(f"it states {n_rows} more rows, but has {left}")
        self._next += n_rows
        return self._lines[self._next - n_rows : self._next]


class BinaryRows:
    """Rows of numbers in binary, as `Rows` has them.

    Args:
        section: its bytes.
        order: of bytes, "<" or ">".
        count_letter: letter of the file's counts, "i" or "q".
    """

    def __init__(self, section: bytes, order: str, count_letter: str) -> None:
        self._data, self._order, self._count_letter = section, order, count_letter
        self._next = 0

    def count(self) -> int:
        end = self._data.find(b"\n", self._next, self._next + 30)
        word = self._data[self._next : max(end, self._next)].decode("ascii", "replace")
        self._next = end + 1
        return _integer(word.strip())

    def integers(self, letters: str) -> list[int]:
        layout = self._order + letters.replace("q", self._count_letter)
        start = self._take(1, struct.calcsize(layout))
        return [*struct.unpack_from(layout, self._data, start)]

    def entity(self, n_coordinates: int, bounded: bool) -> tuple[int, tuple[int, ...]]:
        (number,) = self.integers("i")
        self._take(n_coordinates, 8)
        groups = self._list()
        if bounded:
            self._list()
        return number, groups

    def table(
        self, n_rows: int, letter: str, n_integers: int, n_floats: int
    ) -> tuple[Indices, Array]:
        size = 8 if letter.replace("q", self._count_letter) == "q" else 4
        start = self._take(n_rows, n_integers * size + n_floats * 8)
        integer, number = f"{self._order}i{size}", f"{self._order}f8"
        row = np.dtype([("integers", integer, (n_integers,)), ("floats", number, (n_floats,))])
        rows = np.frombuffer(self._data, row, n_rows, start)
        return rows["integers"].astype(np.int64), rows["floats"].astype(np.float64)

    def tagged_elements(self, n_rows: int) -> Iterator[tuple[int, int, Indices]]:
        while n_rows > 0:
            kind, n_block, n_tags = self.integers("iii")
            if not 0 < n_block <= n_rows or n_tags < 0:
                raise ValueError(f"a block states {n_block} elements with {n_tags} tags each")
            yield kind, n_tags, self.table(n_block, "i", 1 + n_tags + kind_of(kind).n_nodes, 0)[0]
            n_rows -= n_block

    def finish(self) -> None:
        if rest := self._data[self._next :].strip():
            raise ValueError(f"{len(rest)} more bytes are there than it states")

    def _list(self) -> tuple[int, ...]:
        (count,) = self.integers("q")
        start = self._take(count, 4)
        return struct.unpack_from(f"{self._order}{count}i", self._data, start)

    def _take(self, n_rows: int, size: int) -> int:
        left = len(self._data) - self._next
        if n_rows < 0 or n_rows * size > left:
            raise ValueError(f"it states {n_rows} more rows of {size} bytes, but has {left} bytes")
        self._next += n_rows * size
        return self._next - n_rows * size


def _integer(word: str) -> int:
    if not _INTEGER.fullmatch(word):
        raise ValueError(f"'{_short(word)}' is no integer of at most 18 digits")
    return int(word)


def _short(line: str) -> str:
    line = " ".join(line.split())
    return line if len(line) <= 60 else line[:57] + "..."


def _split_list(words: list[str]) -> tuple[list[int], list[str]]:
    """Split a list, whose length stands before it, from the words that follow."""
    count = _integer(words[0]) if words else -1
    if not 0 <= count < len(words):
        raise ValueError("an entity has fewer numbers than it states")
    return [_integer(word) for word in words[1 : 1 + count]], words[1 + count :]


def _parse(lines: list[str], n_integers: int, n_floats: int) -> tuple[Indices, Array]:
    n_columns = n_integers + n_floats
    if not lines:
        return np.empty((0, n_integers), dtype=np.int64), np.empty((0, n_floats))
    for line in lines:
        if len(line.split()) != n_columns:
            raise ValueError(f"row '{_short(line)}' has to have {n_columns} numbers")
    numbers: npt.NDArray[np.float64 | np.int64]
    try:
        kind = np.float64 if n_floats else np.int64
        numbers = np.fromstring(" ".join(lines), kind, sep=" ")
    except (ValueError, DeprecationWarning):
        numbers = np.empty(0)
    if numbers.size != len(lines) * n_columns:
        raise ValueError(_wrong_word(lines, n_integers))
    numbers = numbers.reshape(-1, n_columns)
    head = numbers[:, :n_integers]
    if n_floats:
        wrong = ~(np.abs(head) < _MAX_EXACT) | (head % 1 != 0)
    else:
        wrong = np.abs(head) >= np.iinfo(np.int64).max
    if wrong.any():
        line = lines[int(np.flatnonzero(wrong.any(axis=1))[0])]
        raise ValueError(f"row '{_short(line)}' has a number of a node that is no such number")
    return head.astype(np.int64), numbers[:, n_integers:].astype(np.float64)


def _wrong_word(lines: list[str], n_integers: int) -> str:
    """Return a message that names the first word which is no number, or no integer."""
    for line in lines:
        for column, word in enumerate(line.split()):
            pattern = r"[+-]?\d+" if column < n_integers else r"[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?"
            if not re.fullmatch(pattern, word, re.IGNORECASE):
                sort = "integer" if column < n_integers else "number"
                return f"'{_short(word)}' in row '{_short(line)}' is no {sort}"
    return "its rows are no numbers"
