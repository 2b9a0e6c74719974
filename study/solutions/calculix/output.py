"""Read numbers from the files that CalculiX writes."""

import re

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


class CalculixError(Exception):
    """Raised if CalculiX is missing, fails, or prints unexpected output."""


def read_tables_below_heading(output: str, heading_start: str) -> list[Array]:
    """Read the tables (rows, columns) below each heading line that begins with `heading_start`."""
    tables: list[list[list[float]]] = []
    is_in_table = False
    for line in output.splitlines():
        words = line.split()
        if words and not re.fullmatch(r"[-+.\dEe]+", words[0]):
            is_in_table = line.strip().startswith(heading_start)
            if is_in_table:
                tables.append([])
        elif words and is_in_table:
            tables[-1].append([float(word) for word in words])
    return [np.array(table) for table in tables]


def read_nodal_values_by_block(output: str) -> dict[str, dict[int, list[float]]]:
    """Read nodal values of a results file (.frd), by block name ("DISP", ...) and node number.

    Of several blocks with the same name, the values of the last one are returned.
    """
    blocks: dict[str, dict[int, list[float]]] = {}
    for name, values in list_nodal_value_blocks(output):
        blocks.setdefault(name, {}).update(values)
    return blocks


def list_nodal_value_blocks(output: str) -> list[tuple[str, dict[int, list[float]]]]:
    """Read nodal values of a results file (.frd) as name and values by node of each block."""
    blocks: list[tuple[str, dict[int, list[float]]]] = []
    block: dict[int, list[float]] | None = None
    for line in output.splitlines():
        if line.startswith(" -4"):
            block = {}
            blocks.append((line.split()[1], block))
        elif line.startswith(" -3"):
            block = None
        elif line.startswith(" -1") and block is not None:
            numbers = line[13:].rstrip()
            block[int(line[3:13])] = [
                float(numbers[k : k + 12]) for k in range(0, len(numbers), 12)
            ]
    return blocks
