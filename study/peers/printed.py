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
