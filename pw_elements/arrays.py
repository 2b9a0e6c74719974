"""Types of NumPy arrays by the type of their entries."""

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]
Indices = npt.NDArray[np.int64]
# Numbers of nodes, facets or cells on a process, of DOLFINx' type
LocalIndices = npt.NDArray[np.int32]
