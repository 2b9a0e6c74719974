"""Mesh with tags of cells and facets, and the creation of such a mesh from arrays on process 0."""

from collections.abc import Mapping
from typing import NamedTuple

from mpi4py import MPI

import basix.ufl
import numpy as np
import numpy.typing as npt
from dolfinx.mesh import Mesh, MeshTags, create_mesh, meshtags

from pw_elements.abaqus import to_upper_ascii
from pw_elements.arrays import Array, Indices, LocalIndices

TagsByKindAndSetName = dict[
    str, dict[str, tuple[int, ...]]
]  # tags of each set, by "cells" or "facets" and by the name of the set


class TaggedMesh(NamedTuple):
    """Mesh with tags of its cells and facets, and the tags of each named set.

    Named sets may overlap. Each combination of sets then has a tag of its own, and a set has the
    tags of all combinations that contain it.

    Args:
        mesh: mesh with these cells and facets.
        cell_tags: tags of cells; `cell_tags.find(1)` returns the local cells with tag 1.
        facet_tags: tags of facets; `facet_tags.find(1)` returns the local facets with tag 1.
        names: under the keys "cells" and "facets", the tags of each named set; for example
            {"cells": {"STEEL": (1,)}, "facets": {"BASE": (1, 3)}}.
    """

    mesh: Mesh
    cell_tags: MeshTags
    facet_tags: MeshTags
    names: TagsByKindAndSetName

    def cells(self, name: str) -> LocalIndices:
        """Return the local numbers of the cells in a named set.

        Args:
            name: name of the set. In sets of Abaqus' files, upper and lower case are equivalent.

        Raises:
            ValueError: if no set has this name.
        """
        return self._find_entities_of_set("cells", self.cell_tags, name)

    def facets(self, name: str) -> LocalIndices:
        """Return the local numbers of the facets in a named set, for use in `boundary_measure`.

        Args:
            name: name of the set. In sets of Abaqus' files, upper and lower case are equivalent.

        Raises:
            ValueError: if no set has this name.
        """
        return self._find_entities_of_set("facets", self.facet_tags, name)

    def _find_entities_of_set(
        self, entity_kind: str, tags: MeshTags, set_name: str
    ) -> LocalIndices:
        tags_of_name = self.names[entity_kind]
        set_tags = tags_of_name.get(set_name, tags_of_name.get(to_upper_ascii(set_name), ()))
        if not set_tags:
            raise ValueError(
                f"no set of {entity_kind} is called {set_name}; known are "
                f"{', '.join(tags_of_name) or 'none'}"
            )
        return tags.indices[np.isin(tags.values, set_tags)]


class MeshArrays(NamedTuple):
    """Arrays of a tagged mesh on one process, from which DOLFINx creates the mesh.

    Args:
        cell_and_degree: type of the cells, such as "triangle", and degree of the geometry.
        x: coordinates (k, dim) of the nodes.
        cells: indices (n, nodes per cell) of the cells' nodes in DOLFINx' order.
        tags: under the key "cells", the tags (n, 1) of the cells; under the key "facets", the tags
            (n, facets per cell) of each cell's facets; 0 for cells and facets without a tag.
        names: under the keys "cells" and "facets", the tags of each named set.
    """

    cell_and_degree: tuple[str, int]
    x: Array
    cells: Indices
    tags: Mapping[str, npt.NDArray[np.integer]]
    names: TagsByKindAndSetName


def create_tagged_mesh(comm: MPI.Comm, arrays: MeshArrays | None) -> TaggedMesh:
    """Create a distributed mesh from arrays on process 0; `arrays` is None on other processes."""
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


def check_constant_z(source_name: str, node_coordinates: Array) -> None:
    """Raise ValueError unless all nodes lie in one plane z = constant.

    Args:
        source_name: name of the file or model, used in the error message.
        node_coordinates: coordinates (n, 3) of the nodes.
    """
    if np.ptp(node_coordinates[:, 2]) > 1e-9 * np.ptp(node_coordinates, axis=0).max():
        raise ValueError(f"{source_name} has plane cells that do not lie in one plane z = constant")
