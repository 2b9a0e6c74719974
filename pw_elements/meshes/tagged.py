"""Mesh with tags of its cells and facets, and its creation from arrays on process 0."""

from collections.abc import Mapping
from typing import NamedTuple

from mpi4py import MPI

import basix.ufl
import numpy as np
import numpy.typing as npt
from dolfinx.mesh import Mesh, MeshTags, create_mesh, meshtags

from pw_elements.abaqus import to_upper_ascii
from pw_elements.arrays import Array, Indices, LocalIndices

SetTags = dict[
    str, dict[str, tuple[int, ...]]
]  # by "cells" and "facets", then by set name: the tags of the set


class TaggedMesh(NamedTuple):
    """Mesh with tags of its cells and facets, and the tags of each named set.

    Named sets may overlap: each combination of sets has its own tag, and a set has several tags.

    Args:
        mesh: the mesh.
        cell_tags: tags of cells; `cell_tags.find(1)` returns the local cells with tag 1.
        facet_tags: tags of facets; `facet_tags.find(1)` returns the local facets with tag 1.
        names: tags of each named set of "cells" and of "facets", such as
            {"cells": {"STEEL": (1,)}, "facets": {"BASE": (1, 3)}}.
    """

    mesh: Mesh
    cell_tags: MeshTags
    facet_tags: MeshTags
    names: SetTags

    def cells(self, name: str) -> LocalIndices:
        """Return the local numbers of the cells in a named set.

        Args:
            name: name of the set; for Abaqus' files, upper and lower case are equivalent.

        Raises:
            ValueError: if there is no such set.
        """
        return self._find("cells", self.cell_tags, name)

    def facets(self, name: str) -> LocalIndices:
        """Return the local numbers of the facets in a named set, e.g. for `boundary_measure`.

        Args:
            name: name of the set; for Abaqus' files, upper and lower case are equivalent.

        Raises:
            ValueError: if there is no such set.
        """
        return self._find("facets", self.facet_tags, name)

    def _find(self, kind: str, tags: MeshTags, name: str) -> LocalIndices:
        tags_of_name = self.names[kind]
        set_tags = tags_of_name.get(name, tags_of_name.get(to_upper_ascii(name), ()))
        if not set_tags:
            raise ValueError(
                f"no set of {kind} is called {name}; known are {', '.join(tags_of_name) or 'none'}"
            )
        return tags.indices[np.isin(tags.values, set_tags)]


class MeshArrays(NamedTuple):
    """Arrays of a tagged mesh on one process, from which DOLFINx creates the mesh.

    Args:
        cell_and_degree: type of the cells, such as "triangle", and degree of the geometry.
        x: coordinates (k, dim) of the nodes.
        cells: indices of nodes (n, nodes per cell) in DOLFINx' order.
        tags: tags of "cells" (n, 1) and of their "facets" (n, facets per cell), 0 for untagged.
        names: tags of each named set of "cells" and of "facets".
    """

    cell_and_degree: tuple[str, int]
    x: Array
    cells: Indices
    tags: Mapping[str, npt.NDArray[np.integer]]
    names: SetTags


def create_tagged_mesh(comm: MPI.Comm, arrays: MeshArrays | None) -> TaggedMesh:
    """Create a distributed mesh from arrays that process 0 has (None on the others)."""
    shared = arrays and (arrays.cell_and_degree, arrays.x.shape[1], arrays.tags, arrays.names)
    (cell, degree), dim, tags, names = comm.bcast(shared)
    element = basix.ufl.element("Lagrange", cell, degree, shape=(dim,))
    if arrays is None or comm.rank:
        coordinates, cells = np.empty((0, dim)), np.empty((0, element.dim // dim), dtype=np.int64)
    else:
        coordinates, cells = arrays.x, arrays.cells
    mesh = create_mesh(comm, cells=cells, x=coordinates, e=element)
    mesh.topology.create_connectivity(dim, dim - 1)
    mesh.topology.create_connectivity(dim - 1, dim)  # needed to locate dofs of facets
    original_cells = mesh.topology.original_cell_index
    entities_of_kind = {
        "cells": np.arange(len(original_cells), dtype=np.int32),
        "facets": mesh.topology.connectivity(dim, dim - 1).array,
    }
    mesh_tags = []
    for codimension, (entity_kind, entities) in enumerate(entities_of_kind.items()):
        entity_tags = tags[entity_kind][original_cells].ravel()
        tagged_entities, first_row = np.unique(entities[entity_tags > 0], return_index=True)
        mesh_tags.append(
            meshtags(
                mesh,
                dim - codimension,
                tagged_entities,
                entity_tags[entity_tags > 0][first_row].astype(np.int32),
            )
        )
    cell_tags, facet_tags = mesh_tags
    return TaggedMesh(mesh, cell_tags, facet_tags, names)


def check_flatness(source: str, x: Array) -> None:
    """Raise ValueError unless nodes x (n, 3) lie in one plane z = constant."""
    if np.ptp(x[:, 2]) > 1e-9 * np.ptp(x, axis=0).max():
        raise ValueError(f"{source} has plane cells that do not lie in one plane z = constant")
