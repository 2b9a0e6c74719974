"""Numbers from what CalculiX prints."""

import re

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


def tables(printed: str, start: str) -> list[Array]:
    """Rows of numbers (rows, columns) below each heading that begins like this."""
    found: list[list[list[float]]] = []
    wanted = False
    for line in printed.splitlines():
        words = line.split()
        if words and not re.fullmatch(r"[-+.\dEe]+", words[0]):
            wanted = line.strip().startswith(start)
            if wanted:
                found.append([])
        elif words and wanted:
            found[-1].append([float(word) for word in words])
    return [np.array(table) for table in found]


def fields(written: str) -> dict[str, dict[int, list[float]]]:
    """Values at nodes, by the names of the blocks of a file of results (.frd)."""
    found: dict[str, dict[int, list[float]]] = {}
    block: dict[int, list[float]] | None = None
    for line in written.splitlines():
        if line.startswith(" -4"):
            block = found.setdefault(line.split()[1], {})
        elif line.startswith(" -3"):
            block = None
        elif line.startswith(" -1") and block is not None:
            numbers = line[13:].rstrip()
            block[int(line[3:13])] = [
                float(numbers[k : k + 12]) for k in range(0, len(numbers), 12)
            ]
    return found
