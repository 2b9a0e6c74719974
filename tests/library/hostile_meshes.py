"""More than 200 hostile mesh files.

They are scripts, contradict themselves, are damaged, or could exhaust memory or time. The function
`describe_mesh_differences` compares a mesh that the library has read with its file.
"""

import random
import re
from copy import deepcopy

import basix
from dolfinx.mesh import entities_to_geometry

from pw_elements._compat import cell_geometry_nodes
from tests.library.msh_files import (
    COMMON_MSH_FORMATS,
    EDGE_CORNERS_IN_GMSH_ORDER,
    N_CORNERS_BY_GMSH_TYPE,
    ElementBlock,
    decode_msh,
    encode_msh,
    make_grouped_lattice_mesh,
)

MSH_2_2_HEADER = b"$MeshFormat\n2.2 0 8\n$EndMeshFormat\n"


def make_hostile_files_with_error_patterns():
    """Return, by name, the bytes of a file and a pattern of its error message.

    The pattern is None if the library may read the file.
    """
    return {
        **_make_script_and_foreign_files(),
        **_make_contradictory_files(),
        **_make_randomly_damaged_files(),
        **_make_resource_exhausting_files(),
    }


def _make_script_and_foreign_files():
    """Return scripts, which create the file `ran` if they are run, and files of other formats."""
    system_call = 'SystemCall "touch {ran}";\n'
    valid_mesh = encode_msh(make_grouped_lattice_mesh("triangle", 1), "4.1").decode()
    scripts = {
        "plain": system_call,
        "comment": "// a mesh\n" + system_call,
        "geometry": "SetFactory('OpenCASCADE');\nBox(1) = {0, 0, 0, 1, 1, 1};\n" + system_call,
        "header in a comment": "// $MeshFormat\n/* 2.2 0 8\n$EndMeshFormat */\n" + system_call,
        "in front of a mesh": system_call + valid_mesh,
        "behind a mesh": valid_mesh + system_call,
        "between sections": valid_mesh.replace("$Nodes", system_call + "$Nodes"),
        "view": 'View "a" { ST(0,0,0,1,0,0,0,1,0){1,2,3}; };\n' + system_call,
        "options": "General.Terminal = 1;\n" + system_call,
        "merge": 'Merge "other.geo";\n',
        "include": 'Include "other.geo";\n',
        "function": "Macro A\n" + system_call + "Return\nCall A;\n",
        "loop": "For i In {1:1}\n" + system_call + "EndFor\n",
        "one line": 'Printf("a"); ' + system_call,
        "marked order of bytes": "\ufeff" + system_call,
        "marked order of bytes before a header": "\ufeff" + valid_mesh + system_call,
        "blank lines": "\n\n\n  " + system_call,
        "no line end": system_call.strip(),
        "python": "import os; os.system('touch {ran}')\n",
        "shell": "#!/bin/sh\ntouch {ran}\n",
        "stl": "solid a\nendsolid a\n",
        "old format": "$NOD\n1\n1 0 0 0\n$ENDNOD\n$ELM\n0\n$ENDELM\n",
        "post-processing": "$PostFormat\n1.4 0 8\n$EndPostFormat\n",
        "parameters": "$PARA\n1\n$ENDPARA\n",
        "empty": "",
        "blank": " \n\t\n",
        "dollar": "$",
        "deck": "*NODE\n1, 0, 0\n",
        "large file pointer": "version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 1\n",
    }
    messages = dict.fromkeys(scripts, "no mesh file of Gmsh")
    messages |= dict.fromkeys(
        ("behind a mesh", "between sections", "dollar"), "between its sections"
    )
    messages |= {
        "old format": "no \\$EndNOD",
        "post-processing": "begins with",
        "parameters": "no ",
    }
    # sections of comments may contain any text
    scripts["in a comment section"] = "$Comments\n" + system_call + "$EndComments\n" + valid_mesh
    return {f"script {name}": (text.encode(), messages.get(name)) for name, text in scripts.items()}


def _make_contradictory_files():
    """Return files of each format whose numbers contradict each other or are not finite."""
    nan, mesh = float("nan"), make_grouped_lattice_mesh("triangle", 2)

    def make_changed_mesh_copy(function, mesh_data=mesh):
        copy = deepcopy(mesh_data)
        function(copy)
        return copy

    def make_node_entry_setter(entry_index, value):
        return lambda m: m.nodes[3].__setitem__(entry_index, value)

    def make_element_entry_setter(entry_index, value):
        return lambda m: m.blocks[0].elements[1].__setitem__(entry_index, value)

    def swap_middle_nodes_of_first_element(m):
        row = m.blocks[0].elements[0]
        row[4], row[5] = row[5], row[4]

    first_elements = mesh.blocks[0].elements
    corner = next(n for row in first_elements for n in row[1:4] if n not in first_elements[1])
    no_node, count_message = "has the node {}, which is not there", "states|than it"
    false_meshes = {
        "missing node": (
            make_changed_mesh_copy(make_element_entry_setter(2, 9999)),
            {},
            no_node.format(9999),
        ),
        "missing middle node": (
            make_changed_mesh_copy(make_element_entry_setter(6, 9999)),
            {},
            no_node.format(9999),
        ),
        "negative node": (
            make_changed_mesh_copy(make_element_entry_setter(2, -5)),
            {},
            no_node.format(-5),
        ),
        "node zero": (
            make_changed_mesh_copy(make_element_entry_setter(2, 0)),
            {},
            no_node.format(0),
        ),
        "largest node": (
            make_changed_mesh_copy(make_element_entry_setter(2, 2**31 - 1)),
            {},
            no_node.format(2**31 - 1),
        ),
        "node twice in a cell": (
            make_changed_mesh_copy(make_element_entry_setter(2, first_elements[1][1])),
            {},
            "has a node twice",
        ),
        "middle node on a corner": (
            make_changed_mesh_copy(make_element_entry_setter(4, corner)),
            {},
            "middle of an edge",
        ),
        "middle nodes exchanged": (
            make_changed_mesh_copy(swap_middle_nodes_of_first_element),
            {},
            "middle of an edge",
        ),
        "two nodes with one number": (
            make_changed_mesh_copy(make_node_entry_setter(0, mesh.nodes[5][0])),
            {},
            "has node .* twice",
        ),
        "two elements with one number": (
            make_changed_mesh_copy(make_element_entry_setter(0, 11)),
            {},
            "has element 11 twice",
        ),
        "two equal cells": (
            make_changed_mesh_copy(
                lambda m: m.blocks[0].elements.append([999, *first_elements[0][1:]])
            ),
            {},
            "elements 11 and 999 have the same nodes",
        ),
        "negative number": (
            make_changed_mesh_copy(make_node_entry_setter(0, -7)),
            {},
            "has node -7",
        ),
        "no nodes stated": (make_changed_mesh_copy(lambda m: m.nodes.clear()), {}, "has no nodes"),
        "nan": (make_changed_mesh_copy(make_node_entry_setter(1, nan)), {}, "lies at"),
        "infinity": (
            make_changed_mesh_copy(make_node_entry_setter(2, float("inf"))),
            {},
            "lies at",
        ),
        "overflow": (make_changed_mesh_copy(make_node_entry_setter(2, 1e300)), {}, "lies at"),
        "bent plane": (
            make_changed_mesh_copy(make_node_entry_setter(3, 0.75)),
            {},
            "not lie in one plane",
        ),
        "unknown type": (deepcopy(mesh), {"kind": 99}, "type 99 are not known"),
        "more nodes": (mesh, {"false_counts": {"nodes": len(mesh.nodes) + 1}}, count_message),
        "fewer nodes": (mesh, {"false_counts": {"nodes": len(mesh.nodes) - 1}}, count_message),
        "more elements": (mesh, {"false_counts": {"elements": 21}}, count_message),
        "fewer elements": (mesh, {"false_counts": {"elements": 9}}, count_message),
        "no nodes": (mesh, {"false_counts": {"nodes": 0, "node block": 0}}, r"\$Nodes: "),
        "1e9 nodes": (mesh, {"false_counts": {"nodes": 10**9, "node block": 10**9}}, count_message),
        "1e9 elements": (
            mesh,
            {"false_counts": {"elements": 10**9, "element block": 10**9}},
            count_message,
        ),
        "minus one nodes": (mesh, {"false_counts": {"nodes": -1, "node block": -1}}, count_message),
        "minus one elements": (
            mesh,
            {"false_counts": {"elements": -1, "element block": -1}},
            count_message,
        ),
        "names": (mesh, {"false_counts": {"names": 10**12}}, "not as many"),
    }
    files = {}
    for k, (name, (mesh_data, options, message)) in enumerate(false_meshes.items()):
        mesh_data.blocks[0].kind = options.pop("kind", mesh_data.blocks[0].kind)
        for file_format in COMMON_MSH_FORMATS[k % 2 :: 2]:
            files[f"{name} {file_format}"] = encode_msh(mesh_data, file_format, **options), message
    huge_counts = {"nodes": 10**12, "elements": 10**12}
    unlisted = {(2, 1): (3,)}
    overlap = {(2, 1): (2**31 - 1, 3), (2, 2): (3,), (1, 5): (3,)}
    for file_format in COMMON_MSH_FORMATS[2:]:
        files[f"1e12 {file_format}"] = encode_msh(mesh, file_format, huge_counts), count_message
        files[f"entity {file_format}"] = (
            encode_msh(mesh, file_format, groups_by_entity=unlisted),
            r"is not in \$Entities",
        )
        files[f"group {file_format}"] = (
            encode_msh(mesh, file_format, groups_by_entity=overlap),
            "give all of these names",
        )
    mixed = deepcopy(make_grouped_lattice_mesh("quadrilateral", 1))
    a, b, c, d = mixed.blocks[0].elements[0][1:]
    mixed.blocks[0].elements[0][0] = 90
    mixed.blocks.append(ElementBlock(2, 1, (3,), [[91, a, b, c], [92, a, c, d]]))
    mixed.blocks[0].elements.pop(0)
    cubic = deepcopy(make_grouped_lattice_mesh("triangle", 1))
    cubic.nodes += [[1000 + k, 0.1 * k, 0.3, 0.25] for k in range(7)]
    for block in cubic.blocks[:2]:
        block.kind = 21
        block.elements = [[*row, *range(1000, 1007)] for row in block.elements]
    serendipity = make_grouped_lattice_mesh("quadrilateral", 2)
    for block in serendipity.blocks[:2]:
        block.kind = 16
        block.elements = [row[:-1] for row in block.elements]
    shells = make_grouped_lattice_mesh("hexahedron", 1)
    shells.blocks[2].kind = 2
    shells.blocks[2].elements = [row[:4] for row in shells.blocks[2].elements]
    for file_format in COMMON_MSH_FORMATS:
        files[f"triangles on bricks {file_format}"] = encode_msh(shells, file_format), None
    lines = make_grouped_lattice_mesh("triangle", 1)
    lines.blocks = lines.blocks[2:]
    for name, mesh_data in (
        ("cells are 3 quadrilaterals of degree 1 (4 nodes) and 2 triangles", mixed),
        ("cells are 8 triangles of degree 3 (10 nodes)", cubic),
        ("cells are 4 quadrilaterals of degree 2 (8 nodes)", serendipity),
        ("has no mesh of plane or solid cells", lines),
    ):
        for file_format in ("2.2", "4.1 binary"):
            files[f"{name} {file_format}"] = encode_msh(mesh_data, file_format), re.escape(name)
    return files


def _make_randomly_damaged_files():
    """Return files that are cut off or changed at random; some of them may still be valid."""
    files, rng = {}, random.Random(48)
    for file_format in COMMON_MSH_FORMATS:
        for cell, degree in (("triangle", 2), ("hexahedron", 1)):
            data = encode_msh(make_grouped_lattice_mesh(cell, degree, 1), file_format)
            for k in range(2):
                cut_position = rng.randrange(40, len(data) - 20)
                files[f"cut {k} {cell} {file_format}"] = (
                    data[:cut_position],
                    "not complete|between its sections",
                )
                damaged = bytearray(data)
                for _ in range(3):
                    damaged[rng.randrange(40, len(data))] = rng.randrange(256)
                files[f"spoilt {k} {cell} {file_format}"] = bytes(damaged), None
            if "binary" not in file_format:
                lines = data.split(b"\n")
                start = lines.index(b"$Nodes") + 2
                numbers = [k for k, line in enumerate(lines) if line[:1].isdigit() and k >= start]
                k = rng.choice(numbers)
                without_line, with_line_twice = (
                    lines[:k] + lines[k + 1 :],
                    lines[: k + 1] + lines[k:],
                )
                message = "states|more rows|has to have"
                files[f"line lost {cell} {file_format}"] = b"\n".join(without_line), message
                files[f"line twice {cell} {file_format}"] = b"\n".join(with_line_twice), message
                words = lines[k].split()
                wrong_word = rng.choice([b"1_0", b"1e", b"0x1", b"1.5.2", b"1d0", b"-", b"1,5"])
                words[rng.randrange(len(words))] = wrong_word
                lines[k] = b" ".join(words)
                files[f"word {cell} {file_format}"] = b"\n".join(lines), "is no (number|integer)"
    return files


def _make_resource_exhausting_files():
    """Return files of at most 1 MB that could take excessive time or memory."""
    nodes = b"$Nodes\n4\n1 0 0 0\n2 1 0 0\n3 1 1 0\n4 0 1 0\n$EndNodes\n"
    cells = b"1 2 2 1 1 1 2 3\n2 2 2 1 1 1 3 4\n"

    def file_with_elements(rows):
        count = b"$Elements\n%d\n" % (len(rows) + 2)
        return MSH_2_2_HEADER + nodes + count + cells + b"".join(rows) + b"$EndElements\n"

    header_4_1 = b"$MeshFormat\n4.1 0 8\n$EndMeshFormat\n"
    node_4 = b"$Nodes\n1 4 1 4\n2 1 0 4\n1\n2\n3\n4\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n$EndNodes\n"
    groups = b" ".join(b"%d" % k for k in range(1, 100_001))
    entities = b"$Entities\n0 0 1 0\n1 0 0 0 1 1 0 %d %s 0\n$EndEntities\n" % (100_000, groups)
    one_entity = b"$Entities\n0 0 1 0\n1 0 0 0 1 1 0 1 3 0\n$EndEntities\n"
    cells_4 = b"$Elements\n1 2 1 2\n2 1 2 2\n1 1 2 3\n2 1 3 4\n$EndElements\n"
    empty_blocks = b"$Elements\n90001 2 1 2\n2 1 2 2\n1 1 2 3\n2 1 3 4\n" + b"2 1 2 0\n" * 90_000
    numbers = range(30_000)
    mesh = nodes + b"$Elements\n2\n" + cells + b"$EndElements\n"
    names = b"".join(b'2 %d "a%d"\n' % (k + 1, k) for k in numbers)
    alternating = [b"%d 15 2 0 1 1\n", b"%d 1 2 0 1 1 2\n"]
    endless = b"$Elements\n999999999999 2 1 2\n2 1 2 2\n1 1 2 3\n2 1 3 4\n$EndElements\n"
    far_cells = cells.replace(b"3 4", b"3 2000000000")
    return {
        "types that alternate": (
            file_with_elements([alternating[k % 2] % (k + 3) for k in numbers]),
            None,
        ),
        "tags in all numbers": (
            file_with_elements(
                [b"%d 15 %d%s 1\n" % (k + 3, k + 2, b" 0" * (k + 2)) for k in range(900)]
            ),
            None,
        ),
        "facet in all groups": (
            file_with_elements([b"%d 1 2 %d 1 1 2\n" % (k + 3, k + 5) for k in numbers]),
            "more than 100 physical groups",
        ),
        "points in all groups": (
            file_with_elements([b"%d 15 2 %d 1 1\n" % (k + 3, k + 5) for k in numbers]),
            None,
        ),
        "cell in all groups": (
            file_with_elements([b"%d 2 2 %d 1 1 2 3\n" % (k + 3, k + 5) for k in numbers]),
            "more than 100 physical groups",
        ),
        "cell again and again": (
            file_with_elements([b"%d 2 2 1 1 1 2 3\n" % (k + 3) for k in numbers]),
            "have the same nodes",
        ),
        "facet again and again": (
            file_with_elements([b"%d 1 2 7 1 1 2\n" % (k + 3) for k in numbers]),
            None,
        ),
        "tags without end": (
            file_with_elements([b"3 2 999999999 1 1 1 2 3\n"]),
            "has to have 1000000005",
        ),
        "entity in all groups": (
            header_4_1 + entities + node_4 + cells_4,
            "more than 100 physical groups",
        ),
        "blocks without elements": (
            header_4_1 + one_entity + node_4 + empty_blocks + b"$EndElements\n",
            None,
        ),
        "blocks without end": (
            header_4_1 + one_entity + node_4 + endless,
            "states 1 more rows, but has 0",
        ),
        "sections without end": (
            header_4_1 + one_entity + node_4 + cells_4 + b"$A\n$EndA\n" * 100_000,
            None,
        ),
        "sections that do not end": (header_4_1 + b"$A\n" * 300_000, "not complete"),
        "blank lines": (MSH_2_2_HEADER + b"\n" * 900_000 + mesh, None),
        "dollars": (b"$" * 900_000, "between its sections"),
        "spaces": (b" " * 900_000, "no mesh file of Gmsh"),
        "one line": (
            MSH_2_2_HEADER + mesh.replace(b"4 0 1 0", b"1" * 900_000),
            "has to have 4 numbers",
        ),
        "digits": (
            MSH_2_2_HEADER + mesh.replace(b"2 1 0 0", b"2 1%s 0 0" % (b"0" * 900_000)),
            "lies at",
        ),
        "far node numbers": (
            MSH_2_2_HEADER
            + nodes.replace(b"\n4 0 1", b"\n2000000000 0 1")
            + b"$Elements\n2\n"
            + far_cells
            + b"$EndElements\n",
            None,
        ),
        "many names": (
            MSH_2_2_HEADER + b"$PhysicalNames\n30000\n" + names + b"$EndPhysicalNames\n" + mesh,
            None,
        ),
        "name without end": (
            MSH_2_2_HEADER
            + b'$PhysicalNames\n1\n2 1 "%s\n$EndPhysicalNames\n' % (b"a" * 900_000)
            + mesh,
            "is no dimension, number and name",
        ),
    }


def collect_groups_by_coordinates(file_content):
    """Return the groups of each cell and facet of a mesh, identified by coordinates of nodes.

    The key of a cell is (corners, edges), with the ends and the middle node of each edge. The key
    of a facet is the set of its corners.
    """
    dim = max(block.dim for block in file_content.blocks if block.elements)
    x = {int(node[0]): tuple(node[1 : 1 + dim]) for node in file_content.nodes}
    assert len(x) == len(file_content.nodes)
    has_groups = any(b.groups for b in file_content.blocks if b.dim == dim)
    cells, facets = {}, {}
    for block in file_content.blocks:
        for _, *nodes in block.elements if block.dim >= dim - 1 else ():
            corners = frozenset(
                x[node] for node in nodes[: N_CORNERS_BY_GMSH_TYPE.get(block.kind, 1)]
            )
            if block.dim == dim - 1 and block.groups:
                facets.setdefault(corners, set()).update(block.groups)
            elif block.dim == dim and (block.groups or not has_groups):
                edges = _pair_edge_ends_with_midpoints(block.kind, [x[node] for node in nodes])
                cells.setdefault((corners, edges), set()).update(block.groups)
    sides = {corners for corners, _ in cells}
    n_corners = {(2, 3): 2, (2, 4): 2, (3, 4): 3, (3, 8): 4}[dim, len(next(iter(sides)))]
    facets = {
        facet: groups
        for facet, groups in facets.items()
        if len(facet) == n_corners and any(facet < corners for corners in sides)
    }
    return {"cells": cells, "facets": facets}


def _pair_edge_ends_with_midpoints(gmsh_type, node_positions):
    edge_corners = {6: "triangle", 9: "quadrilateral", 10: "tetrahedron", 27: "hexahedron"}
    edge_corners = (
        EDGE_CORNERS_IN_GMSH_ORDER[edge_corners[len(node_positions)]]
        if len(node_positions) in edge_corners
        else []
    )
    n_corners = N_CORNERS_BY_GMSH_TYPE[gmsh_type]
    return frozenset(
        (frozenset((node_positions[a], node_positions[b])), node_positions[n_corners + k])
        for k, (a, b) in enumerate(edge_corners)
    )


def describe_mesh_differences(tagged_mesh, file_content):
    """Return a description of the differences between a mesh and the content of its file.

    The description is an empty string if there are none.
    """
    mesh, expected = tagged_mesh.mesh, collect_groups_by_coordinates(file_content)
    dim = mesh.topology.dim
    x = mesh.geometry.x[:, :dim].tolist()
    element = mesh.ufl_domain().ufl_coordinate_element().basix_element
    n_corners = len(element.entity_dofs[0])
    edges = basix.topology(element.cell_type)[1] if element.degree == 2 else []
    cells = []
    for nodes in cell_geometry_nodes(mesh):
        positions = [tuple(x[node]) for node in nodes]
        middles = [positions[inside[0]] for inside in element.entity_dofs[1] if inside]
        ends = [frozenset(positions[k] for k in edge) for edge in edges]
        cells.append((frozenset(positions[:n_corners]), frozenset(zip(ends, middles, strict=True))))
    if sorted(map(hash, cells)) != sorted(map(hash, expected["cells"])):
        return f"{len(cells)} cells, stated are {len(expected['cells'])}, or others"
    mesh.topology.create_connectivity(dim - 1, dim)
    tagged = tagged_mesh.facet_tags.indices
    facets = entities_to_geometry(mesh, dim - 1, tagged) if len(tagged) else []
    n_corners = len(basix.topology(element.cell_type)[dim - 1][0])
    read_entities = {
        "cells": (cells, tagged_mesh.cell_tags),
        "facets": ([frozenset(tuple(x[k]) for k in row[:n_corners]) for row in facets],
                   tagged_mesh.facet_tags),
    }  # fmt: skip
    for entity_kind, (positions, tags) in read_entities.items():
        tag = dict(zip(tags.indices.tolist(), tags.values.tolist(), strict=True))
        if entity_kind == "facets":
            tag = dict(enumerate(tags.values.tolist()))
        entity_dim = dim if entity_kind == "cells" else dim - 1
        groups = {position: {tag.get(k, 0)} - {0} for k, position in enumerate(positions)}
        names = {}
        for (of_dim, group), name in file_content.names.items():
            if of_dim == entity_dim and name:
                names.setdefault(name, set()).add(group)
        for position, expected_groups in expected[entity_kind].items():
            expected_groups = {g for g in expected_groups if g}
            if len(expected_groups) < 2 and groups.get(position, set()) != expected_groups:
                return (
                    f"{entity_kind}: tags {groups.get(position)} where groups are {expected_groups}"
                )
            for name, members in names.items():
                is_member = bool(
                    groups.get(position, set()) & {*tagged_mesh.names[entity_kind].get(name, ())}
                )
                if is_member != bool(members & expected_groups):
                    return f"{entity_kind}: {name} at {position}"
        if not {p for p, g in groups.items() if g} <= expected[entity_kind].keys():
            return f"{entity_kind} have tags that are in no group"
    return ""


def describe_differences_from_file(tagged_mesh, msh_path):
    """Return a description of how a mesh differs from an independent reading of its file.

    The description is an empty string if there are none.
    """
    return describe_mesh_differences(tagged_mesh, decode_msh(msh_path.read_bytes()))
