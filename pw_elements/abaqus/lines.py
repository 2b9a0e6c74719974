"""Stream reader for Abaqus input files: lines, keywords with their parameters, and numbers.

The syntax rules are given in the "Abaqus Analysis User's Guide", Input Syntax Rules, and in
G. Dhondt, "CalculiX CrunchiX User's Manual", version 2.20, section 7. Outside of quoted names,
blanks are ignored and the letters a to z are converted to upper case, except in file names. Text
that is not valid UTF-8 is decoded as Latin-1.
"""

import re
import string
from collections.abc import Callable, Iterator, Set
from io import StringIO
from pathlib import Path
from typing import IO, NamedTuple

# Largest depth of nested INCLUDEs, the limit of CalculiX
MAX_INCLUDE_DEPTH = 9
MAX_INCLUDED_FILES = 10_000
# Largest number of characters of a line
MAX_CHARACTERS_PER_LINE = 1_000_000
# Limit of the number of characters that are read if files are included repeatedly: the first
# constant times the total size of all files, plus the second constant
MAX_CHARACTERS_READ_OVER_FILE_SIZES, MAX_EXTRA_CHARACTERS_READ_BY_INCLUDES = 3, 1_000_000
# Largest number of a node or element: the limit of CalculiX, which is higher than that of Abaqus
MAX_NODE_OR_ELEMENT_NUMBER = 2**31 - 1
# Parameters without a value: only these, or entries with "=", continue a keyword line
PARAMETERS_WITHOUT_VALUE = ("GENERATE", "INTERNAL", "UNSORTED", "DLOAD")

_ASCII_TO_UPPER_CASE_TABLE = str.maketrans(string.ascii_lowercase, string.ascii_uppercase)
_INTEGER_ROW_PATTERN = re.compile(r"[\d,+ \t]*", re.ASCII)
_REAL_ROW_PATTERN = re.compile(r"[\d.,eEdD+\- \t]*", re.ASCII)
_COMMA_SEPARATED_ENTRY_PATTERN = re.compile(r'((?:"[^"]*"|[^,"])*)(?:,|$)')
_QUOTED_OR_UNQUOTED_PATTERN = re.compile(r'"([^"]*)"|([^"]+)')


class ErrorWithFileAndLine(ValueError):
    """ValueError with a message that begins with the file and the line."""


class KeywordBlock(NamedTuple):
    """Block of an input file: a keyword, its parameters, and the rows that follow it.

    Args:
        keyword: name of the keyword without blanks, such as "NODE".
        parameters: value of each parameter by name; "" for parameters without a value.
        location: file, line and keyword of the block, used in error messages.
        rows: lines of text after the keyword, which have to be read before the next block.
        current_location: function that returns file and line of the row that was read last.
    """

    keyword: str
    parameters: dict[str, str]
    location: str
    rows: Iterator[str]
    current_location: Callable[[], str]


def read_keyword_blocks(path: Path, keywords: Set[str]) -> Iterator[KeywordBlock]:
    """Yield the blocks with given keywords in a file and in the files that it includes.

    Args:
        path: path of the file.
        keywords: keywords of the blocks; blocks with other keywords are skipped.

    Raises:
        FileNotFoundError: if a file does not exist.
        ValueError: if a file is not text, includes itself, or includes other files too often.
    """
    source = _LineReaderWithIncludes(path)
    try:
        for _ in _read_rows_until_keyword(source):  # rows before the first keyword are ignored
            pass
        if not source.next_keyword:
            raise ErrorWithFileAndLine(f"{path} has no keyword, such as *NODE: it is no input file")
        while source.next_keyword:
            keyword, parameters, location = source.next_keyword
            source.next_keyword = None
            if keyword not in keywords:
                for _ in _read_rows_until_keyword(source):
                    pass
                continue
            if keyword in ("NODE", "ELEMENT") and "INPUT" in parameters:
                source.include_file(parameters.pop("INPUT"), location)
            rows = _read_rows_until_keyword(source)
            yield KeywordBlock(keyword, parameters, location, rows, lambda: source.file_and_line)
            for _ in rows:
                pass
    finally:
        source.close()


def _read_rows_until_keyword(source: "_LineReaderWithIncludes") -> Iterator[str]:
    """Yield the rows up to the next keyword line, which is stored in `source.next_keyword`.

    Included files are read in place of the lines that include them.
    """
    while (text := source.next_line()) is not None:
        if not text.startswith("*"):
            yield text
            continue
        keyword, parameters = _parse_keyword_line(text, source)
        if keyword != "INCLUDE":
            source.next_keyword = keyword, parameters, f"{source.file_and_line}, *{keyword}"
            return
        source.include_file(parameters.get("INPUT", ""), f"{source.file_and_line}, *{keyword}")


def _parse_keyword_line(
    first_line: str, source: "_LineReaderWithIncludes"
) -> tuple[str, dict[str, str]]:
    """Return the keyword of a line and its parameters.

    If the line ends with a comma and the next line begins with a parameter, the next line is a
    continuation and its parameters are included.
    """
    if "," not in first_line:
        return normalize_name(first_line[1:], source.file_and_line), {}
    keyword_lines = [first_line]
    while keyword_lines[-1].endswith(","):
        next_line = source.next_line()
        if next_line is None:
            break
        first_entry = next_line.partition(",")[0]
        if next_line.startswith("*") or not (
            "=" in first_entry or to_upper_ascii(first_entry.strip()) in PARAMETERS_WITHOUT_VALUE
        ):
            source.put_back(next_line)
            break
        keyword_lines.append(next_line)
    location = source.file_and_line
    keyword, *pairs = split_at_unquoted_commas("".join(keyword_lines), location)
    parameters: dict[str, str] = {}
    for pair in pairs:
        key, _, value = pair.partition("=")
        key = normalize_name(key, location)
        if key in parameters:
            raise ErrorWithFileAndLine(f"{location}: the parameter {key} is given twice")
        if key:
            parameters[key] = value.strip(" \t")
    return normalize_name(keyword[1:], location), parameters


class _LineReaderWithIncludes:
    """Stream of the stripped lines of a file and of the files that it includes.

    Comments and blank lines are left out.
    """

    def __init__(self, path: Path) -> None:
        self._open_files: list[_TextFileReader] = []
        self._main_path, self._returned_lines = path, list[str]()
        self.next_keyword: tuple[str, dict[str, str], str] | None = None
        self._sizes: dict[Path, int] = {}
        self._n_characters = self._n_includes = 0
        self._open_file(path)

    @property
    def file_and_line(self) -> str:
        """File and number of the line that was read last, used in error messages."""
        return f"{self._current_file.name}, line {self._current_file.number}"

    def next_line(self) -> str | None:
        if self._returned_lines:
            return self._returned_lines.pop()
        while self._open_files:
            self._current_file = self._open_files[-1]
            while (text := self._current_file.next_line()) is not None:
                if text and not text.startswith("**"):
                    return text
            self._open_files.pop().text.close()
        return None

    def close(self) -> None:
        for file in self._open_files:
            file.text.close()

    def put_back(self, text: str) -> None:
        self._returned_lines.append(text)

    def include_file(self, file_name: str, location: str) -> None:
        """Continue with the lines of another file.

        Args:
            file_name: path of the file, relative to the folder of the including file or, if there
                is no such file, relative to the folder of the main file.
            location: file and line of the include, used in error messages.
        """
        if not file_name.strip('" \t'):
            raise ErrorWithFileAndLine(f"{location}: INPUT=... is missing, the name of a file")
        file_name = file_name.strip('"')
        relative_path = self._current_file.path.parent / file_name
        path = relative_path if relative_path.is_file() else self._main_path.parent / file_name
        if not path.is_file():
            raise FileNotFoundError(f"{location}: there is no file {relative_path}")
        self._n_includes += 1
        resolved = path.resolve()
        if any(resolved == file.resolved for file in self._open_files):
            raise ErrorWithFileAndLine(f"{location}: {path} includes itself")
        if len(self._open_files) > MAX_INCLUDE_DEPTH:
            raise ErrorWithFileAndLine(
                f"{location}: files include each other over more than {MAX_INCLUDE_DEPTH} levels"
            )
        if self._n_includes > MAX_INCLUDED_FILES:
            raise ErrorWithFileAndLine(
                f"{location}: more than {MAX_INCLUDED_FILES} files are included"
            )
        self._open_file(path)

    def _open_file(self, path: Path) -> None:
        if not path.is_file():
            raise FileNotFoundError(f"there is no file {path}")
        file = _TextFileReader(path)
        self._open_files.append(file)
        self._current_file = file
        self._n_characters += file.size
        self._sizes[file.resolved] = file.size
        if (
            self._n_characters
            > MAX_CHARACTERS_READ_OVER_FILE_SIZES * sum(self._sizes.values())
            + MAX_EXTRA_CHARACTERS_READ_BY_INCLUDES
        ):
            raise ErrorWithFileAndLine(
                f"{path} is included too often: its text would be read without end"
            )


class _TextFileReader:
    """Open text file with lines that end with a line feed, a carriage return, or both."""

    def __init__(self, path: Path) -> None:
        self.path, self.resolved = path, path.resolve()
        self.name, self.number = str(path), 0
        self.size = path.stat().st_size
        with path.open("rb") as file:
            leading_bytes = file.read(3) if self.size else b""
        self._is_utf16 = leading_bytes[:2] in (b"\xff\xfe", b"\xfe\xff")
        # files of size 0 are not opened: they may be devices, and reading them might never end
        encoding = "utf-16" if self._is_utf16 else "latin-1"
        self.text: IO[str] = path.open(encoding=encoding) if self.size else StringIO()
        if leading_bytes == b"\xef\xbb\xbf":
            self.text.read(3)

    def next_line(self) -> str | None:
        self.number += 1
        try:
            text = self.text.readline(MAX_CHARACTERS_PER_LINE)
            if not text:
                return None
            if not text.isascii() and not self._is_utf16:
                text = _redecode_as_utf8_if_valid(text)
        except UnicodeError as error:
            raise ErrorWithFileAndLine(
                f"{self.path}, line {self.number}: this is no text"
            ) from error
        if "\0" in text:
            raise ErrorWithFileAndLine(f"{self.path}, line {self.number}: this is no text")
        if len(text) >= MAX_CHARACTERS_PER_LINE and not text.endswith("\n"):
            raise ErrorWithFileAndLine(
                f"{self.path}, line {self.number}: the line is longer than "
                f"{MAX_CHARACTERS_PER_LINE} "
                "characters"
            )
        return text.strip(" \t\n")


def _redecode_as_utf8_if_valid(latin1_text: str) -> str:
    try:
        return latin1_text.encode("latin-1").decode("utf-8")
    except UnicodeDecodeError:
        return latin1_text


def quote_shortened(text: str) -> str:
    """Return a text in quotes, truncated after 40 characters."""
    return repr(text if len(text) <= 40 else text[:40] + "...")


def split_at_unquoted_commas(text: str, location: str) -> list[str]:
    """Split a row at commas outside of quotes, and drop empty entries at the end."""
    if '"' not in text:
        fields = [field.strip(" \t") for field in text.split(",")]
    elif text.count('"') % 2:
        raise ErrorWithFileAndLine(
            f"{location}: a quotation mark is missing in {quote_shortened(text)}"
        )
    else:
        fields = [field.strip(" \t") for field in _COMMA_SEPARATED_ENTRY_PATTERN.findall(text)]
    while fields and not fields[-1]:
        fields.pop()
    return fields or [""]


def normalize_name(text: str, location: str) -> str:
    """Return a name in upper case without blanks; quoted parts are unchanged."""
    if '"' in text:
        if text.count('"') % 2:
            raise ErrorWithFileAndLine(
                f"{location}: a quotation mark is missing in {quote_shortened(text)}"
            )
        return "".join(
            quoted or normalize_name(unquoted, location)
            for quoted, unquoted in _QUOTED_OR_UNQUOTED_PATTERN.findall(text)
        )
    return to_upper_ascii(text.replace(" ", "").replace("\t", ""))


def to_upper_ascii(text: str) -> str:
    """Convert the letters a to z to upper case.

    Other letters are unchanged, because Unicode's upper case could make different names equal.
    """
    return text.upper() if text.isascii() else text.translate(_ASCII_TO_UPPER_CASE_TABLE)


def is_unsigned_integer(text: str) -> bool:
    """Return whether an entry is the number of a node or element rather than a name."""
    return text.isdigit() and text.isascii()


def parse_comma_separated_integers(text: str, minimum: int = 1) -> list[int]:
    """Parse a row of numbers of nodes or elements; commas at the end are ignored.

    Raises:
        ValueError: for an entry that is not an integer from `minimum` to
            `MAX_NODE_OR_ELEMENT_NUMBER`.
    """
    if not _INTEGER_ROW_PATTERN.fullmatch(text):
        wrong_entry = next(
            field for field in text.split(",") if not _INTEGER_ROW_PATTERN.fullmatch(field)
        )
        raise ValueError(
            f"{quote_shortened(wrong_entry.strip())} is no number of a node or an element"
        )
    fields = text.rstrip(", \t").split(",")
    try:
        numbers = [int(field) for field in fields]
    except ValueError as error:
        raise ValueError(
            f"{quote_shortened(text)} has an entry that is empty, or no number"
        ) from error
    if min(numbers) < minimum or max(numbers) > MAX_NODE_OR_ELEMENT_NUMBER:
        raise ValueError(
            f"{quote_shortened(text)}: numbers have to be from {minimum} to "
            f"{MAX_NODE_OR_ELEMENT_NUMBER}"
        )
    return numbers


def parse_node_row(text: str) -> tuple[int, list[float]]:
    """Parse a row with the number of a node and its coordinates.

    Empty or missing coordinates are 0. Up to three more entries, the components of a normal vector,
    are ignored.

    Returns:
        Number of the node, and its three coordinates.

    Raises:
        ValueError: if a coordinate is not a number, or there are too many entries.
    """
    if not _REAL_ROW_PATTERN.fullmatch(text):
        wrong_entry = next(
            field for field in text.split(",") if not _REAL_ROW_PATTERN.fullmatch(field)
        )
        raise ValueError(f"{quote_shortened(wrong_entry.strip())} is no number")
    number, *fields = text.rstrip(", \t").replace("D", "E").replace("d", "e").split(",")
    try:
        x = [float(field) if field.strip(" \t") else 0.0 for field in fields[:3]]
    except ValueError as error:
        raise ValueError(f"{quote_shortened(text)} has a coordinate that is no number") from error
    if len(fields) > 6 or not is_unsigned_integer(number.strip(" \t")):
        raise ValueError(f"{quote_shortened(text)} is no row of a node: number, x, y, z")
    return parse_comma_separated_integers(number)[0], x + [0.0] * (3 - len(x))
