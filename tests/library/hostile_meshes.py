"""Mesh files that lie, are broken, or are none: more than 200, always the same ones.

`python -m tests.library.hostile_meshes FOLDER` reads each file of a folder under limits of CPU time
and memory, and writes a line of JSON about it: what a process that dies has said tells which file
killed it.
"""

import json
import logging
import random
import re
import resource
import signal
import subprocess
import sys
import time
from copy import deepcopy
from pathlib import Path

from tests.library.msh_files import (
    EDGES,
    FORMATS,
    N_CORNERS,
    Block,
    lattice,
    read,
    write,
)

CPU_SECONDS, MEGABYTES = 2.0, 500
PROJECT = Path(__file__).parents[2]
HEAD = b"$MeshFormat\n2.2 0 8\n$EndMeshFormat\n"


def hostile_files():
    """Return files by names, with the words in which each is refused, or None if it may be read."""
    return {**_scripts(), **_false_meshes(), **_damaged_files(), **_greedy_files()}


def _scripts():
    """Give scripts of Gmsh, each of which makes a file `ran` beside it if it is run."""
    call = 'SystemCall "touch {ran}";\n'
    valid = write(lattice("triangle", 1), "4.1").decode()
    scripts = {
        "plain": call,
        "comment": "// a mesh\n" + call,
        "geometry": "SetFactory('OpenCASCADE');\nBox(1) = {0, 0, 0, 1, 1, 1};\n" + call,
        "header in a comment": "// $MeshFormat\n/* 2.2 0 8\n$EndMeshFormat */\n" + call,
        "in front of a mesh": call + valid,
        "behind a mesh": valid + call,
        "between sections": valid.replace("$Nodes", call + "$Nodes"),
        "view": 'View "a" { ST(0,0,0,1,0,0,0,1,0){1,2,3}; };\n' + call,
        "options": "General.Terminal = 1;\n" + call,
        "merge": 'Merge "other.geo";\n',
        "include": 'Include "other.geo";\n',
        "function": "Macro A\n" + call + "Return\nCall A;\n",
        "loop": "For i In {1:1}\n" + call + "EndFor\n",
        "one line": 'Printf("a"); ' + call,
        "marked order of bytes": "\ufeff" + call,
        "marked order of bytes before a header": "\ufeff" + valid + call,
        "blank lines": "\n\n\n  " + call,
        "no line end": call.strip(),
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
    words = dict.fromkeys(scripts, "no mesh file of Gmsh")
    words |= dict.fromkeys(("behind a mesh", "between sections", "dollar"), "between its sections")
    words |= {"old format": "no \\$EndNOD", "post-processing": "begins with", "parameters": "no "}
    # in a section that is passed over it is text like any other
    scripts["in a comment section"] = "$Comments\n" + call + "$EndComments\n" + valid
    return {f"script {name}": (text.encode(), words.get(name)) for name, text in scripts.items()}


def _false_meshes():
    """Give files of each format whose numbers contradict each other, or are no numbers."""
    nan, cell = float("nan"), lattice("triangle", 2)

    def change(function, stated=cell):
        changed = deepcopy(stated)
        function(changed)
        return changed

    def node(k, value):
        return lambda m: m.nodes[3].__setitem__(k, value)

    def element(k, value):
        return lambda m: m.blocks[0].elements[1].__setitem__(k, value)

    def exchange(m):
        row = m.blocks[0].elements[0]
        row[4], row[5] = row[5], row[4]

    first = cell.blocks[0].elements
    corner = next(n for row in first for n in row[1:4] if n not in first[1])
    no_node, states = "has the node {}, which is not there", "states|than it"
    false = {
        "missing node": (change(element(2, 9999)), {}, no_node.format(9999)),
        "missing middle node": (change(element(6, 9999)), {}, no_node.format(9999)),
        "negative node": (change(element(2, -5)), {}, no_node.format(-5)),
        "node zero": (change(element(2, 0)), {}, no_node.format(0)),
        "largest node": (change(element(2, 2**31 - 1)), {}, no_node.format(2**31 - 1)),
        "node twice in a cell": (change(element(2, first[1][1])), {}, "has a node twice"),
        "middle node on a corner": (change(element(4, corner)), {}, "middle of an edge"),
        "middle nodes exchanged": (change(exchange), {}, "middle of an edge"),
        "two nodes with one number": (change(node(0, cell.nodes[5][0])), {}, "has node .* twice"),
        "two elements with one number": (change(element(0, 11)), {}, "has element 11 twice"),
        "two equal cells": (
            change(lambda m: m.blocks[0].elements.append([999, *first[0][1:]])),
            {},
            "elements 11 and 999 have the same nodes",
        ),
        "negative number": (change(node(0, -7)), {}, "has node -7"),
        "no nodes stated": (change(lambda m: m.nodes.clear()), {}, "has no nodes"),
        "nan": (change(node(1, nan)), {}, "lies at"),
        "infinity": (change(node(2, float("inf"))), {}, "lies at"),
        "overflow": (change(node(2, 1e300)), {}, "lies at"),
        "bent plane": (change(node(3, 0.75)), {}, "not lie in one plane"),
        "unknown type": (deepcopy(cell), {"kind": 99}, "type 99 are not known"),
        "more nodes": (cell, {"counts": {"nodes": len(cell.nodes) + 1}}, states),
        "fewer nodes": (cell, {"counts": {"nodes": len(cell.nodes) - 1}}, states),
        "more elements": (cell, {"counts": {"elements": 21}}, states),
        "fewer elements": (cell, {"counts": {"elements": 9}}, states),
        "no nodes": (cell, {"counts": {"nodes": 0, "node block": 0}}, r"\$Nodes: "),
        "1e9 nodes": (cell, {"counts": {"nodes": 10**9, "node block": 10**9}}, states),
        "1e9 elements": (cell, {"counts": {"elements": 10**9, "element block": 10**9}}, states),
        "minus one nodes": (cell, {"counts": {"nodes": -1, "node block": -1}}, states),
        "minus one elements": (cell, {"counts": {"elements": -1, "element block": -1}}, states),
        "names": (cell, {"counts": {"names": 10**12}}, "not as many"),
    }
    files = {}
    for k, (name, (stated, how, words)) in enumerate(false.items()):
        stated.blocks[0].kind = how.pop("kind", stated.blocks[0].kind)
        for form in FORMATS[k % 2 :: 2]:
            files[f"{name} {form}"] = write(stated, form, **how), words
    far = {"nodes": 10**12, "elements": 10**12}
    unlisted = {(2, 1): (3,)}
    overlap = {(2, 1): (2**31 - 1, 3), (2, 2): (3,), (1, 5): (3,)}
    for form in FORMATS[2:]:
        files[f"1e12 {form}"] = write(cell, form, far), states
        files[f"entity {form}"] = write(cell, form, entities=unlisted), r"is not in \$Entities"
        files[f"group {form}"] = write(cell, form, entities=overlap), "give all of these names"
    mixed = deepcopy(lattice("quadrilateral", 1))
    a, b, c, d = mixed.blocks[0].elements[0][1:]
    mixed.blocks[0].elements[0][0] = 90
    mixed.blocks.append(Block(2, 1, (3,), [[91, a, b, c], [92, a, c, d]]))
    mixed.blocks[0].elements.pop(0)
    cubic = deepcopy(lattice("triangle", 1))
    cubic.nodes += [[1000 + k, 0.1 * k, 0.3, 0.25] for k in range(7)]
    for block in cubic.blocks[:2]:
        block.kind = 21
        block.elements = [[*row, *range(1000, 1007)] for row in block.elements]
    serendipity = lattice("quadrilateral", 2)
    for block in serendipity.blocks[:2]:
        block.kind = 16
        block.elements = [row[:-1] for row in block.elements]
    shells = lattice("hexahedron", 1)
    shells.blocks[2].kind = 2
    shells.blocks[2].elements = [row[:4] for row in shells.blocks[2].elements]
    for form in FORMATS:
        files[f"triangles on bricks {form}"] = write(shells, form), None
    lines = lattice("triangle", 1)
    lines.blocks = lines.blocks[2:]
    for name, stated in (
        ("cells are 3 quadrilaterals of degree 1 (4 nodes) and 2 triangles", mixed),
        ("cells are 8 triangles of degree 3 (10 nodes)", cubic),
        ("cells are 4 quadrilaterals of degree 2 (8 nodes)", serendipity),
        ("has no mesh of plane or solid cells", lines),
    ):
        for form in ("2.2", "4.1 binary"):
            files[f"{name} {form}"] = write(stated, form), re.escape(name)
    return files


def _damaged_files():
    """Give files with a part cut off or changed at random; by chance some are still meshes."""
    files, rng = {}, random.Random(48)
    for form in FORMATS:
        for cell, degree in (("triangle", 2), ("hexahedron", 1)):
            data = write(lattice(cell, degree, 1), form)
            for k in range(2):
                cut = rng.randrange(40, len(data) - 20)
                files[f"cut {k} {cell} {form}"] = data[:cut], "not complete|between its sections"
                spoilt = bytearray(data)
                for _ in range(3):
                    spoilt[rng.randrange(40, len(data))] = rng.randrange(256)
                files[f"spoilt {k} {cell} {form}"] = bytes(spoilt), None
            if "binary" not in form:
                lines = data.split(b"\n")
                start = lines.index(b"$Nodes") + 2
                numbers = [k for k, line in enumerate(lines) if line[:1].isdigit() and k >= start]
                k = rng.choice(numbers)
                lost, twice = lines[:k] + lines[k + 1 :], lines[: k + 1] + lines[k:]
                rows = "states|more rows|has to have"
                files[f"line lost {cell} {form}"] = b"\n".join(lost), rows
                files[f"line twice {cell} {form}"] = b"\n".join(twice), rows
                words = lines[k].split()
                changed = rng.choice([b"1_0", b"1e", b"0x1", b"1.5.2", b"1d0", b"-", b"1,5"])
                words[rng.randrange(len(words))] = changed
                lines[k] = b" ".join(words)
                files[f"word {cell} {form}"] = b"\n".join(lines), "is no (number|integer)"
    return files


def _greedy_files():
    """Give files of at most 1 MB that could take time or memory out of all proportion."""
    nodes = b"$Nodes\n4\n1 0 0 0\n2 1 0 0\n3 1 1 0\n4 0 1 0\n$EndNodes\n"
    cells = b"1 2 2 1 1 1 2 3\n2 2 2 1 1 1 3 4\n"

    def of_elements(rows):
        count = b"$Elements\n%d\n" % (len(rows) + 2)
        return HEAD + nodes + count + cells + b"".join(rows) + b"$EndElements\n"

    new = b"$MeshFormat\n4.1 0 8\n$EndMeshFormat\n"
    node_4 = b"$Nodes\n1 4 1 4\n2 1 0 4\n1\n2\n3\n4\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n$EndNodes\n"
    groups = b" ".join(b"%d" % k for k in range(1, 100_001))
    entities = b"$Entities\n0 0 1 0\n1 0 0 0 1 1 0 %d %s 0\n$EndEntities\n" % (100_000, groups)
    few = b"$Entities\n0 0 1 0\n1 0 0 0 1 1 0 1 3 0\n$EndEntities\n"
    cells_4 = b"$Elements\n1 2 1 2\n2 1 2 2\n1 1 2 3\n2 1 3 4\n$EndElements\n"
    empty_blocks = b"$Elements\n90001 2 1 2\n2 1 2 2\n1 1 2 3\n2 1 3 4\n" + b"2 1 2 0\n" * 90_000
    many = range(30_000)
    mesh = nodes + b"$Elements\n2\n" + cells + b"$EndElements\n"
    names = b"".join(b'2 %d "a%d"\n' % (k + 1, k) for k in many)
    alternating = [b"%d 15 2 0 1 1\n", b"%d 1 2 0 1 1 2\n"]
    endless = b"$Elements\n999999999999 2 1 2\n2 1 2 2\n1 1 2 3\n2 1 3 4\n$EndElements\n"
    far = cells.replace(b"3 4", b"3 2000000000")
    return {
        "types that alternate": (of_elements([alternating[k % 2] % (k + 3) for k in many]), None),
        "tags in all numbers": (
            of_elements([b"%d 15 %d%s 1\n" % (k + 3, k + 2, b" 0" * (k + 2)) for k in range(900)]),
            None,
        ),
        "facet in all groups": (
            of_elements([b"%d 1 2 %d 1 1 2\n" % (k + 3, k + 5) for k in many]),
            "more than 100 physical groups",
        ),
        "points in all groups": (
            of_elements([b"%d 15 2 %d 1 1\n" % (k + 3, k + 5) for k in many]),
            None,
        ),
        "cell in all groups": (
            of_elements([b"%d 2 2 %d 1 1 2 3\n" % (k + 3, k + 5) for k in many]),
            "more than 100 physical groups",
        ),
        "cell again and again": (
            of_elements([b"%d 2 2 1 1 1 2 3\n" % (k + 3) for k in many]),
            "have the same nodes",
        ),
        "facet again and again": (of_elements([b"%d 1 2 7 1 1 2\n" % (k + 3) for k in many]), None),
        "tags without end": (of_elements([b"3 2 999999999 1 1 1 2 3\n"]), "has to have 1000000005"),
        "entity in all groups": (
            new + entities + node_4 + cells_4,
            "more than 100 physical groups",
        ),
        "blocks without elements": (new + few + node_4 + empty_blocks + b"$EndElements\n", None),
        "blocks without end": (new + few + node_4 + endless, "states 1 more rows, but has 0"),
        "sections without end": (new + few + node_4 + cells_4 + b"$A\n$EndA\n" * 100_000, None),
        "sections that do not end": (new + b"$A\n" * 300_000, "not complete"),
        "blank lines": (HEAD + b"\n" * 900_000 + mesh, None),
        "dollars": (b"$" * 900_000, "between its sections"),
        "spaces": (b" " * 900_000, "no mesh file of Gmsh"),
        "one line": (HEAD + mesh.replace(b"4 0 1 0", b"1" * 900_000), "has to have 4 numbers"),
        "digits": (HEAD + mesh.replace(b"2 1 0 0", b"2 1%s 0 0" % (b"0" * 900_000)), "lies at"),
        "far node numbers": (
            HEAD
            + nodes.replace(b"\n4 0 1", b"\n2000000000 0 1")
            + b"$Elements\n2\n"
            + far
            + b"$EndElements\n",
            None,
        ),
        "many names": (
            HEAD + b"$PhysicalNames\n30000\n" + names + b"$EndPhysicalNames\n" + mesh,
            None,
        ),
        "name without end": (
            HEAD + b'$PhysicalNames\n1\n2 1 "%s\n$EndPhysicalNames\n' % (b"a" * 900_000) + mesh,
            "is no dimension, number and name",
        ),
    }


def summary(stated):
    """Return cells and facets of a mesh as it is stated: nodes' places, and names or groups.

    Each is {(corners, (ends and middle of each edge)): groups}, by coordinates of the nodes.
    """
    dim = max(block.dim for block in stated.blocks if block.elements)
    x = {int(node[0]): tuple(node[1 : 1 + dim]) for node in stated.nodes}
    assert len(x) == len(stated.nodes)
    grouped = any(b.groups for b in stated.blocks if b.dim == dim)
    cells, facets = {}, {}
    for block in stated.blocks:
        for _, *nodes in block.elements if block.dim >= dim - 1 else ():
            corners = frozenset(x[node] for node in nodes[: N_CORNERS.get(block.kind, 1)])
            if block.dim == dim - 1 and block.groups:
                facets.setdefault(corners, set()).update(block.groups)
            elif block.dim == dim and (block.groups or not grouped):
                edges = _edges(block.kind, [x[node] for node in nodes])
                cells.setdefault((corners, edges), set()).update(block.groups)
    sides = {corners for corners, _ in cells}
    n_corners = {(2, 3): 2, (2, 4): 2, (3, 4): 3, (3, 8): 4}[dim, len(next(iter(sides)))]
    facets = {
        facet: groups
        for facet, groups in facets.items()
        if len(facet) == n_corners and any(facet < corners for corners in sides)
    }
    return {"cells": cells, "facets": facets}


def _edges(kind, places):
    pairs = {6: "triangle", 9: "quadrilateral", 10: "tetrahedron", 27: "hexahedron"}
    pairs = EDGES[pairs[len(places)]] if len(places) in pairs else []
    n_corners = N_CORNERS[kind]
    return frozenset(
        (frozenset((places[a], places[b])), places[n_corners + k]) for k, (a, b) in enumerate(pairs)
    )


def differences(part, stated):
    """Return what a mesh that was read has otherwise than the file states, or ""."""
    import basix
    from dolfinx.mesh import entities_to_geometry

    from pw_elements._compat import cell_nodes

    mesh, expected = part.mesh, summary(stated)
    dim = mesh.topology.dim
    x = mesh.geometry.x[:, :dim].tolist()
    element = mesh.ufl_domain().ufl_coordinate_element().basix_element
    n_corners = len(element.entity_dofs[0])
    edges = basix.topology(element.cell_type)[1] if element.degree == 2 else []
    cells = []
    for nodes in cell_nodes(mesh):
        places = [tuple(x[node]) for node in nodes]
        middles = [places[inside[0]] for inside in element.entity_dofs[1] if inside]
        ends = [frozenset(places[k] for k in edge) for edge in edges]
        cells.append((frozenset(places[:n_corners]), frozenset(zip(ends, middles, strict=True))))
    if sorted(map(hash, cells)) != sorted(map(hash, expected["cells"])):
        return f"{len(cells)} cells, stated are {len(expected['cells'])}, or others"
    mesh.topology.create_connectivity(dim - 1, dim)
    tagged = part.facet_tags.indices
    facets = entities_to_geometry(mesh, dim - 1, tagged) if len(tagged) else []
    n_corners = len(basix.topology(element.cell_type)[dim - 1][0])
    found = {
        "cells": (cells, part.cell_tags),
        "facets": ([frozenset(tuple(x[k]) for k in row[:n_corners]) for row in facets],
                   part.facet_tags),
    }  # fmt: skip
    for what, (places, tags) in found.items():
        tag = dict(zip(tags.indices.tolist(), tags.values.tolist(), strict=True))
        if what == "facets":
            tag = dict(enumerate(tags.values.tolist()))
        d = dim if what == "cells" else dim - 1
        groups = {place: {tag.get(k, 0)} - {0} for k, place in enumerate(places)}
        names = {}
        for (of_dim, group), name in stated.names.items():
            if of_dim == d and name:
                names.setdefault(name, set()).add(group)
        for place, stated_groups in expected[what].items():
            stated_groups = {g for g in stated_groups if g}
            if len(stated_groups) < 2 and groups.get(place, set()) != stated_groups:
                return f"{what}: tags {groups.get(place)} where groups are {stated_groups}"
            for name, members in names.items():
                is_in = bool(groups.get(place, set()) & {*part.names[what].get(name, ())})
                if is_in != bool(members & stated_groups):
                    return f"{what}: {name} at {place}"
        if not {p for p, g in groups.items() if g} <= expected[what].keys():
            return f"{what} have tags that are in no group"
    return ""


def read_all(folder):
    """Read the files of a folder in processes of their own; return what is known of each by name.

    A file that ends the process with a signal has "died" with that signal.
    """
    results = {}
    left = sorted(path.name for path in folder.glob("*.msh"))
    while left:
        command = [sys.executable, "-m", "tests.library.hostile_meshes", str(folder), *left]
        run = subprocess.run(command, cwd=PROJECT, capture_output=True, text=True)
        lines = [json.loads(line) for line in run.stdout.splitlines() if line.startswith("{")]
        results |= {line["file"]: line for line in lines}
        if run.returncode == 0:
            assert len(lines) == len(left)
            break
        assert len(lines) < len(left), run.stderr
        died = left[len(lines)]
        results[died] = {
            "file": died,
            "outcome": f"died with {run.returncode}: {run.stderr[-300:]}",
        }
        left = left[len(lines) + 1 :]
    return results


def main(folder, names):
    from mpi4py import MPI

    from pw_elements.meshes import from_file

    logging.disable()
    for name in names:
        path = folder / name
        result = {"file": name}
        part = None
        Path("/proc/self/clear_refs").write_text("5")  # the peak of memory begins anew
        before, start = _memory("VmRSS"), time.process_time()
        signal.setitimer(signal.ITIMER_PROF, CPU_SECONDS)  # which ends the process
        try:
            part = from_file(path, MPI.COMM_SELF)
            result["outcome"] = "read"
        except (ValueError, FileNotFoundError) as error:
            result["outcome"] = "refused"
            result["message"] = str(error)
        except BaseException as error:
            result["outcome"] = f"raw {type(error).__name__}: {error}"
        signal.setitimer(signal.ITIMER_PROF, 0)
        result["seconds"] = round(time.process_time() - start, 3)
        result["megabytes"] = _memory("VmHWM") - before
        if part is not None:
            try:
                result["differences"] = differences(part, read(path.read_bytes()))
            except Exception as error:
                result["differences"] = f"it cannot be read otherwise: {error!r}"
        print(json.dumps(result), flush=True)


def _memory(what):
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith(what):
            return int(line.split()[1]) // 1000
    raise KeyError(what)


if __name__ == "__main__":
    # beyond what the libraries reserve, but do not use
    limit = 8_000_000_000
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
    main(Path(sys.argv[1]), sys.argv[2:])
