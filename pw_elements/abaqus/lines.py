"""Text of Abaqus' input files, read as a stream: lines, keywords with their parameters, numbers.

Rules of the syntax: "Abaqus Analysis User's Guide", Input Syntax Rules; G. Dhondt, "CalculiX
CrunchiX User's Manual", version 2.20, section 7. Blanks count in quoted names alone; a to z become
capitals but in quoted names and names of files. Bytes that are no UTF-8 are taken as Latin-1.
"""

import re
import string
from collections.abc import Callable, Iterator, Set
from io import StringIO
from pathlib import Path
from typing import IO, NamedTuple

# CalculiX' own limit of files that include each other
MAX_DEPTH = 9
MAX_INCLUDES = 10_000
# Characters in one line
MAX_LINE = 1_000_000
# Text that files included more than once may add: so many times their sizes, and so many characters
MAX_REPEATS, MAX_REPEATED_TEXT = 3, 1_000_000
# Of nodes and elements: CalculiX' own, and more than Abaqus'
MAX_NUMBER = 2**31 - 1
# Parameters without a value
FLAGS = ("GENERATE", "INTERNAL", "UNSORTED", "DLOAD")

_CAPITALS = str.maketrans(string.ascii_lowercase, string.ascii_uppercase)
_INTEGERS = re.compile(r"[\d,+ \t]*", re.ASCII)
_REALS = re.compile(r"[\d.,eEdD+\- \t]*", re.ASCII)
_FIELD = re.compile(r'((?:"[^"]*"|[^,"])*)(?:,|$)')
_NO_QUOTES = re.compile(r'"([^"]*)"|([^"]+)')


class PlacedError(ValueError):
    """A ValueError whose words begin with file and line."""


class Block(NamedTuple):
    """A keyword such as NODE, without blanks, its parameters, and its rows of text.

    Rows have to be taken before the next block is asked for. `place` is where the keyword stands,
    `here()` the line that was read last.
    """

    keyword: str
    parameters: dict[str, str]
    place: str
    rows: Iterator[str]
    here: Callable[[], str]


def read_blocks(path: Path, keywords: Set[str]) -> Iterator[Block]:
    """Yield the blocks of some keywords from a file and those that it includes.

    Raises:
        FileNotFoundError: if a file is not there.
        ValueError: for a file that is no text, that includes itself, or that repeats others without
            end.
    """
    source = _Source(path)
    try:
        for _ in _rows(source):  # what stands before the first keyword says nothing
            pass
        if not source.head:
            raise PlacedError(f"{path} has no keyword, such as *NODE: it is no input file")
        while source.head:
            keyword, parameters, place = source.head
            source.head = None
            if keyword not in keywords:
                for _ in _rows(source):
                    pass
                continue
            if keyword in ("NODE", "ELEMENT") and "INPUT" in parameters:
                source.include(parameters.pop("INPUT"), place)
            rows = _rows(source)
            yield Block(keyword, parameters, place, rows, lambda: source.place)
            for _ in rows:
                pass
    finally:
        source.close()


def _rows(source: "_Source") -> Iterator[str]:
    """Yield rows, included ones too, up to the next keyword, the source's `head` from then on."""
    while (text := source.next_line()) is not None:
        if not text.startswith("*"):
            yield text
            continue
        keyword, parameters = _keyword(text, source)
        if keyword != "INCLUDE":
            source.head = keyword, parameters, f"{source.place}, *{keyword}"
            return
        source.include(parameters.get("INPUT", ""), f"{source.place}, *{keyword}")


def _keyword(text: str, source: "_Source") -> tuple[str, dict[str, str]]:
    """Return keyword and parameters.

    After a comma at the end the next line goes on, if it has a parameter and is no row.
    """
    if "," not in text:
        return label(text[1:], source.place), {}
    lines = [text]
    while lines[-1].endswith(","):
        following = source.next_line()
        if following is None:
            break
        first = following.partition(",")[0]
        if following.startswith("*") or not ("=" in first or capitals(first.strip()) in FLAGS):
            source.put_back(following)
            break
        lines.append(following)
    place = source.place
    keyword, *pairs = entries("".join(lines), place)
    parameters: dict[str, str] = {}
    for pair in pairs:
        key, _, value = pair.partition("=")
        key = label(key, place)
        if key in parameters:
            raise PlacedError(f"{place}: the parameter {key} is given twice")
        if key:
            parameters[key] = value.strip(" \t")
    return label(keyword[1:], place), parameters


class _Source:
    """Lines of files that include each other, without comments, blank lines and outer blanks."""

    def __init__(self, path: Path) -> None:
        self._open: list[_File] = []
        self._main, self._waiting = path, list[str]()
        self.head: tuple[str, dict[str, str], str] | None = None
        self._sizes: dict[Path, int] = {}
        self._read = self._includes = 0
        self._push(path)

    @property
    def place(self) -> str:
        """Name of the file and number of the line that was read last."""
        return f"{self._last.name}, line {self._last.number}"

    def next_line(self) -> str | None:
        if self._waiting:
            return self._waiting.pop()
        while self._open:
            self._last = self._open[-1]
            while (text := self._last.next_line()) is not None:
                if text and not text.startswith("**"):
                    return text
            self._open.pop().text.close()
        return None

    def close(self) -> None:
        for file in self._open:
            file.text.close()

    def put_back(self, text: str) -> None:
        self._waiting.append(text)

    def include(self, name: str, place: str) -> None:
        """Read the lines of another file next.

        Names are relative to the folder of the file that includes it, or else to the first one's.
        """
        if not name.strip('" \t'):
            raise PlacedError(f"{place}: INPUT=... is missing, the name of a file")
        name = name.strip('"')
        beside = self._last.path.parent / name
        path = beside if beside.is_file() else self._main.parent / name
        if not path.is_file():
            raise FileNotFoundError(f"{place}: there is no file {beside}")
        self._includes += 1
        resolved = path.resolve()
        if any(resolved == file.resolved for file in self._open):
            raise PlacedError(f"{place}: {path} includes itself")
        if len(self._open) > MAX_DEPTH:
            raise PlacedError(
                f"{place}: files include each other over more than {MAX_DEPTH} levels"
            )
        if self._includes > MAX_INCLUDES:
            raise PlacedError(f"{place}: more than {MAX_INCLUDES} files are included")
        self._push(path)

    def _push(self, path: Path) -> None:
        if not path.is_file():
            raise FileNotFoundError(f"there is no file {path}")
        file = _File(path)
        self._open.append(file)
        self._last = file
        self._read += file.size
        self._sizes[file.resolved] = file.size
        if self._read > MAX_REPEATS * sum(self._sizes.values()) + MAX_REPEATED_TEXT:
            raise PlacedError(f"{path} is included too often: its text would be read without end")


class _File:
    """An open file, whose lines end with line feed, carriage return, or both."""

    def __init__(self, path: Path) -> None:
        self.path, self.resolved = path, path.resolve()
        self.name, self.number = str(path), 0
        self.size = path.stat().st_size
        with path.open("rb") as file:
            mark = file.read(3) if self.size else b""
        self._wide = mark[:2] in (b"\xff\xfe", b"\xfe\xff")
        # what has no size, such as a file of the system, is not opened: it might never end
        wide = "utf-16" if self._wide else "latin-1"
        self.text: IO[str] = path.open(encoding=wide) if self.size else StringIO()
        if mark == b"\xef\xbb\xbf":
            self.text.read(3)

    def next_line(self) -> str | None:
        self.number += 1
        try:
            text = self.text.readline(MAX_LINE)
            if not text:
                return None
            if not text.isascii() and not self._wide:
                text = _decoded(text)
        except UnicodeError as error:
            raise PlacedError(f"{self.path}, line {self.number}: this is no text") from error
        if "\0" in text:
            raise PlacedError(f"{self.path}, line {self.number}: this is no text")
        if len(text) >= MAX_LINE and not text.endswith("\n"):
            raise PlacedError(
                f"{self.path}, line {self.number}: the line is longer than {MAX_LINE} characters"
            )
        return text.strip(" \t\n")


def _decoded(text: str) -> str:
    try:
        return text.encode("latin-1").decode("utf-8")
    except UnicodeDecodeError:
        return text


def shortened(text: str) -> str:
    """Return a text in quotes, its first 40 characters if it is longer."""
    return repr(text if len(text) <= 40 else text[:40] + "...")


def entries(text: str, place: str) -> list[str]:
    """Split a row at its commas, but those in quotes; empty entries at the end do not count."""
    if '"' not in text:
        parts = [part.strip(" \t") for part in text.split(",")]
    elif text.count('"') % 2:
        raise PlacedError(f"{place}: a quotation mark is missing in {shortened(text)}")
    else:
        parts = [part.strip(" \t") for part in _FIELD.findall(text)]
    while parts and not parts[-1]:
        parts.pop()
    return parts or [""]


def label(text: str, place: str) -> str:
    """Return a name: in capitals and without blanks, but as it is where it is in quotes."""
    if '"' in text:
        if text.count('"') % 2:
            raise PlacedError(f"{place}: a quotation mark is missing in {shortened(text)}")
        return "".join(quoted or label(plain, place) for quoted, plain in _NO_QUOTES.findall(text))
    return capitals(text.replace(" ", "").replace("\t", ""))


def capitals(text: str) -> str:
    """Return a text with a to z in capitals; other letters are not changed, so that none merge."""
    return text.upper() if text.isascii() else text.translate(_CAPITALS)


def is_number(text: str) -> bool:
    """Whether an entry is a number of a node or an element, and no name."""
    return text.isdigit() and text.isascii()


def integers(text: str, least: int = 1) -> list[int]:
    """Read a row of numbers of nodes and elements; commas at its end do not count.

    Raises:
        ValueError: for what is not a number from `least` to `MAX_NUMBER`.
    """
    if not _INTEGERS.fullmatch(text):
        wrong = next(part for part in text.split(",") if not _INTEGERS.fullmatch(part))
        raise ValueError(f"{shortened(wrong.strip())} is no number of a node or an element")
    parts = text.rstrip(", \t").split(",")
    try:
        numbers = [int(part) for part in parts]
    except ValueError as error:
        raise ValueError(f"{shortened(text)} has an entry that is empty, or no number") from error
    if min(numbers) < least or max(numbers) > MAX_NUMBER:
        raise ValueError(f"{shortened(text)}: numbers have to be from {least} to {MAX_NUMBER}")
    return numbers


def coordinates(text: str) -> tuple[int, list[float]]:
    """Read the number of a node and its three coordinates, of which empty or missing ones are 0.

    After them the row may have the components of a normal, which are not read.

    Raises:
        ValueError: for a coordinate that is no number.
    """
    if not _REALS.fullmatch(text):
        wrong = next(part for part in text.split(",") if not _REALS.fullmatch(part))
        raise ValueError(f"{shortened(wrong.strip())} is no number")
    number, *parts = text.rstrip(", \t").replace("D", "E").replace("d", "e").split(",")
    try:
        x = [float(part) if part.strip(" \t") else 0.0 for part in parts[:3]]
    except ValueError as error:
        raise ValueError(f"{shortened(text)} has a coordinate that is no number") from error
    if len(parts) > 6 or not is_number(number.strip(" \t")):
        raise ValueError(f"{shortened(text)} is no row of a node: number, x, y, z")
    return integers(number)[0], x + [0.0] * (3 - len(x))
