"""A mesh with tags of its cells and facets, and how it is made from arrays on process 0."""

from collections.abc import Mapping
from typing import NamedTuple

from mpi4py import MPI

import basix.ufl
import numpy as np
import numpy.typing as npt
from dolfinx.mesh import Mesh, MeshTags, create_mesh, meshtags

from pw_elements.abaqus import capitals
from pw_elements.arrays import Array, Indices, LocalIndices

Names = dict[str, dict[str, tuple[int, ...]]]  # of "cells" and "facets": the tags of each set


class TaggedMesh(NamedTuple):
    """A mesh, tags of its cells and facets, and which tags a named set has.

    Sets of Abaqus' files may overlap: cells, or facets, that lie in the same sets share one tag.

    Args:
        mesh: the mesh.
        cell_tags: `cell_tags.find(STEEL)` are the local cells of one tag.
        facet_tags: `facet_tags.find(BASE)` are the local facets of one tag.
        names: of sets of "cells" and of "facets", with the tags of each, such as
            {"cells": {"STEEL": (1,)}, "facets": {"BASE": (1, 3)}}.
    """

    mesh: Mesh
    cell_tags: MeshTags
    facet_tags: MeshTags
    names: Names

    def cells(self, name: str) -> LocalIndices:
        """Local numbers of the cells in a named set.

        Args:
            name: of the set; upper and lower case are alike for Abaqus' files.

        Raises:
            ValueError: if there is no such set.
        """
        return self._find("cells", self.cell_tags, name)

    def facets(self, name: str) -> LocalIndices:
        """Local numbers of the facets in a named set, as `boundary_measure` takes them.

        Args:
            name: of the set; upper and lower case are alike for Abaqus' files.

        Raises:
            ValueError: if there is no such set.
        """
        return self._find("facets", self.facet_tags, name)

    def _find(self, kind: str, tags: MeshTags, name: str) -> LocalIndices:
        known = self.names[kind]
        own = known.get(name, known.get(capitals(name), ()))
        if not own:
            raise ValueError(
                f"no set of {kind} is called {name}; known are {', '.join(known) or 'none'}"
            )
        return tags.indices[np.isin(tags.values, own)]


class MeshArrays(NamedTuple):
    """A mesh on one process, before DOLFINx has it.

    Args:
        kind: cell and degree of the geometry.
        x: coordinates (k, dim) of the nodes.
        cells: nodes (n, nodes of each) of the cells, in DOLFINx' order.
        tags: of "cells" (n, 1) and of their "facets" (n, facets of each), 0 being none.
        names: of sets of "cells" and "facets", with the tags of each.
    """

    kind: tuple[str, int]
    x: Array
    cells: Indices
    tags: Mapping[str, npt.NDArray[np.integer]]
    names: Names


def distribute(comm: MPI.Comm, arrays: MeshArrays | None) -> TaggedMesh:
    """Make a mesh of all processes from the arrays of process 0; others need not have any."""
    stated = arrays and (arrays.kind, arrays.x.shape[1], arrays.tags, arrays.names)
    (cell, degree), dim, tags, names = comm.bcast(stated)
    element = basix.ufl.element("Lagrange", cell, degree, shape=(dim,))
    if arrays is None or comm.rank:
        x, cells = np.empty((0, dim)), np.empty((0, element.dim // dim), dtype=np.int64)
    else:
        x, cells = arrays.x, arrays.cells
    mesh = create_mesh(comm, cells=cells, x=x, e=element)
    mesh.topology.create_connectivity(dim, dim - 1)
    mesh.topology.create_connectivity(dim - 1, dim)  # by which DOLFINx finds nodes of facets
    original = mesh.topology.original_cell_index
    entities = {
        "cells": np.arange(len(original), dtype=np.int32),
        "facets": mesh.topology.connectivity(dim, dim - 1).array,
    }
    made = []
    for k, (what, entity) in enumerate(entities.items()):
        tag = tags[what][original].ravel()
        tagged, first = np.unique(entity[tag > 0], return_index=True)
        made.append(meshtags(mesh, dim - k, tagged, tag[tag > 0][first].astype(np.int32)))
    cell_tags, facet_tags = made
    return TaggedMesh(mesh, cell_tags, facet_tags, names)


def check_plane(whose: str, x: Array) -> None:
    """Refuse nodes (n, 3) of plane cells that do not lie in one plane z = constant."""
    if np.ptp(x[:, 2]) > 1e-9 * np.ptp(x, axis=0).max():
        raise ValueError(f"{whose} has plane cells that do not lie in one plane z = constant")
