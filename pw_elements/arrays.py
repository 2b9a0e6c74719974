"""Types of NumPy arrays, by their entries."""

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]
Indices = npt.NDArray[np.int64]
LocalIndices = npt.NDArray[
    np.int32
]  # numbers of nodes, facets or cells on a process, as DOLFINx has them
