"""Read numbers from the files that CalculiX writes."""

import re

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


class CalculixError(Exception):
    """CalculiX is missing, fails, or prints something else than expected."""


def read_tables(output: str, heading: str) -> list[Array]:
    """Return the numbers below each heading that begins with this text, arrays (rows, columns)."""
    tables: list[list[list[float]]] = []
    is_in_table = False
    for line in output.splitlines():
        words = line.split()
        if words and not re.fullmatch(r"[-+.\dEe]+", words[0]):
            is_in_table = line.strip().startswith(heading)
            if is_in_table:
                tables.append([])
        elif words and is_in_table:
            tables[-1].append([float(word) for word in words])
    return [np.array(table) for table in tables]


def read_node_values(output: str) -> dict[str, dict[int, list[float]]]:
    """Return the values at nodes, by names of blocks, of a file of results (.frd)."""
    blocks: dict[str, dict[int, list[float]]] = {}
    block: dict[int, list[float]] | None = None
    for line in output.splitlines():
        if line.startswith(" -4"):
            block = blocks.setdefault(line.split()[1], {})
        elif line.startswith(" -3"):
            block = None
        elif line.startswith(" -1") and block is not None:
            numbers = line[13:].rstrip()
            block[int(line[3:13])] = [
                float(numbers[k : k + 12]) for k in range(0, len(numbers), 12)
            ]
    return blocks
