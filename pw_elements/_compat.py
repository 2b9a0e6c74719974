"""What DOLFINx 0.9 and its successors name differently, and what this library once did."""

import warnings
from collections.abc import Callable, Mapping

import numpy as np
import numpy.typing as npt
from dolfinx.mesh import Mesh


def cell_nodes(mesh: Mesh) -> npt.NDArray[np.int32]:
    """Numbers (cells, nodes) of the geometry's nodes in each cell, ghosts included."""
    geometry = mesh.geometry
    return geometry.dofmaps[0] if hasattr(geometry, "dofmaps") else geometry.dofmap


def renamed(module: str, names: Mapping[str, tuple[str, object]]) -> Callable[[str], object]:
    """A module's `__getattr__` that hands out renamed things by their old names, with a warning.

    Args:
        module: its name.
        names: old name to new name and thing.
    """

    def __getattr__(name: str) -> object:
        if name not in names:
            raise AttributeError(f"module {module!r} has no attribute {name!r}")
        new, thing = names[name]
        warnings.warn(f"{module}.{name} is now called {new}", DeprecationWarning, stacklevel=2)
        return thing

    return __getattr__
