"""Mesh files that lie, are broken, or are none: 180 of them, always the same ones.

`python -m tests.library.hostile_meshes FOLDER` reads each file of a folder under limits of CPU time
and memory, and writes a line of JSON about it: what a process that dies has said tells which file
killed it.
"""

import json
import logging
import random
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
GROUP = b'$PhysicalNames\n1\n2 3 "a"\n$EndPhysicalNames\n'


def hostile_files():
    """Return files by their names: those of "refused ..." are to be, others may be read."""
    files = {**_scripts(), **_false_meshes(), **_damaged_files(), **_greedy_files()}
    assert len(files) > 180
    return files


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
    files = {f"refused script {name}": text.encode() for name, text in scripts.items()}
    # in a section that is passed over it is text like any other
    files["script in a comment section"] = (
        "$Comments\n" + call + "$EndComments\n" + valid
    ).encode()
    return files


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

    def retype(kind):
        return lambda m: m.blocks.__setitem__(0, Block(kind, 1, (3,), m.blocks[0].elements))

    def exchange(m):
        row = m.blocks[0].elements[0]
        row[4], row[5] = row[5], row[4]

    first = cell.blocks[0].elements
    false = {
        "missing node": (change(element(2, 9999)), {}),
        "missing middle node": (change(element(6, 9999)), {}),
        "negative node": (change(element(2, -5)), {}),
        "node zero": (change(element(2, 0)), {}),
        "largest node": (change(element(2, 2**31 - 1)), {}),
        "node twice in a cell": (change(element(2, first[1][1])), {}),
        "middle node on a corner": (change(element(4, first[1][1])), {}),
        "middle nodes exchanged": (change(exchange), {}),
        "two nodes with one number": (change(node(0, cell.nodes[5][0])), {}),
        "two elements with one number": (change(element(0, first[0][0])), {}),
        "two equal cells": (
            change(lambda m: m.blocks[0].elements.append([999, *first[0][1:]])),
            {},
        ),
        "nan": (change(node(1, nan)), {}),
        "infinity": (change(node(2, float("inf"))), {}),
        "overflow": (change(node(2, 1e300)), {}),
        "bent plane": (change(node(3, 0.75)), {}),
        "unknown type": (change(retype(9), cell), {"kind": 99}),
        "more nodes": (cell, {"counts": {"nodes": len(cell.nodes) + 1}}),
        "fewer nodes": (cell, {"counts": {"nodes": len(cell.nodes) - 1}}),
        "more elements": (cell, {"counts": {"elements": 21}}),
        "fewer elements": (cell, {"counts": {"elements": 9}}),
        "no nodes": (cell, {"counts": {"nodes": 0, "node block": 0}}),
        "1e9 nodes": (cell, {"counts": {"nodes": 10**9, "node block": 10**9}}),
        "1e9 elements": (cell, {"counts": {"elements": 10**9, "element block": 10**9}}),
        "minus one nodes": (cell, {"counts": {"nodes": -1, "node block": -1}}),
        "minus one elements": (cell, {"counts": {"elements": -1, "element block": -1}}),
        "names": (cell, {"counts": {"names": 10**12}}),
    }
    files = {}
    for k, (name, (stated, how)) in enumerate(false.items()):
        kind = how.pop("kind", None)
        for form in FORMATS[k % 2 :: 2]:
            if kind:
                stated.blocks[0].kind = kind
            files[f"refused {name} {form}"] = write(stated, form, **how)
    far = {"counts": {"nodes": 10**12, "elements": 10**12}}
    for form in ("4.0", "4.0 binary", "4.1", "4.1 binary"):
        files[f"refused 1e12 {form}"] = write(cell, form, **far)
        files[f"refused entity {form}"] = write(cell, form, entities={(2, 1): (3,)})
        files[f"refused group {form}"] = write(
            cell, form, entities={(2, 1): (2**31 - 1, 3), (2, 2): (3,), (1, 5): (3,)}
        )
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
    lines = lattice("triangle", 1)
    lines.blocks = lines.blocks[2:]
    for name, stated in (
        ("mixed cells", mixed),
        ("cubic", cubic),
        ("serendipity", serendipity),
        ("lines", lines),
    ):
        for form in ("2.2", "4.1 binary"):
            files[f"refused {name} {form}"] = write(stated, form)
    return files


def _damaged_files():
    """Give files with a part cut off or changed at random; by chance some are still meshes."""
    files, rng = {}, random.Random(48)
    for form in FORMATS:
        for cell, degree in (("triangle", 2), ("hexahedron", 1)):
            data = write(lattice(cell, degree, 1), form)
            for k in range(2):
                cut = rng.randrange(40, len(data) - 20)
                files[f"refused cut {k} {cell} {form}"] = data[:cut]
                spoilt = bytearray(data)
                for _ in range(3):
                    spoilt[rng.randrange(40, len(data))] = rng.randrange(256)
                files[f"spoilt {k} {cell} {form}"] = bytes(spoilt)
            if "binary" not in form:
                lines = data.split(b"\n")
                numbers = [k for k, line in enumerate(lines) if line[:1].isdigit()][2:]
                k = rng.choice(numbers)
                files[f"refused line lost {cell} {form}"] = b"\n".join(lines[:k] + lines[k + 1 :])
                files[f"refused line twice {cell} {form}"] = b"\n".join(lines[: k + 1] + lines[k:])
                words = lines[k].split()
                changed = rng.choice([b"1_0", b"1e", b"0x1", b"1.5.2", b"1d0", b"-", b"1,5"])
                words[rng.randrange(len(words))] = changed
                lines[k] = b" ".join(words)
                # bounding boxes of entities, in format 4, are passed over
                title = "refused word" if form == "2.2" else "word"
                files[f"{title} {cell} {form}"] = b"\n".join(lines)
    return files


def _greedy_files():
    """Give files of at most 1 MB that could take time or memory out of all proportion."""
    nodes = b"$Nodes\n4\n1 0 0 0\n2 1 0 0\n3 1 1 0\n4 0 1 0\n$EndNodes\n"
    cells = b"1 2 2 1 1 1 2 3\n2 2 2 1 1 1 3 4\n"

    def of_elements(rows, count=None):
        count = len(rows) + 2 if count is None else count
        body = b"$Elements\n%d\n" % count + cells + b"".join(rows) + b"$EndElements\n"
        return HEAD + nodes + body

    new = b"$MeshFormat\n4.1 0 8\n$EndMeshFormat\n"
    two = b"1 2 1 2\n2 1 2 2\n"
    node_4 = b"$Nodes\n1 4 1 4\n2 1 0 4\n1\n2\n3\n4\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n$EndNodes\n"
    groups = b" ".join(b"%d" % k for k in range(1, 100_001))
    entities = b"$Entities\n0 0 1 0\n1 0 0 0 1 1 0 %d %s 0\n$EndEntities\n" % (100_000, groups)
    few = b"$Entities\n0 0 1 0\n1 0 0 0 1 1 0 1 3 0\n$EndEntities\n"
    cells_4 = b"$Elements\n1 2 1 2\n2 1 2 2\n1 1 2 3\n2 1 3 4\n$EndElements\n"
    empty_blocks = b"$Elements\n90001 2 1 2\n2 1 2 2\n1 1 2 3\n2 1 3 4\n" + b"2 1 2 0\n" * 90_000
    many = range(30_000)
    return {
        "types that alternate": of_elements(
            [b"%d %d 2 0 1 1%s\n" % (k + 3, (15, 1)[k % 2], (b"", b" 2")[k % 2]) for k in many]
        ),
        "tags in all numbers": of_elements(
            [b"%d 15 %d%s 1\n" % (k + 3, k + 2, b" 0" * (k + 2)) for k in range(900)]
        ),
        "facets in all groups": of_elements([b"%d 1 2 %d 1 1 2\n" % (k + 3, k + 5) for k in many]),
        "points in all groups": of_elements([b"%d 15 2 %d 1 1\n" % (k + 3, k + 5) for k in many]),
        "refused cell in all groups": of_elements(
            [b"%d 2 2 %d 1 1 2 3\n" % (k + 3, k + 5) for k in many]
        ),
        "refused cell again and again": of_elements(
            [b"%d 2 2 1 1 1 2 3\n" % (k + 3) for k in many]
        ),
        "facet again and again": of_elements([b"%d 1 2 7 1 1 2\n" % (k + 3) for k in many]),
        "refused tags without end": of_elements([b"3 2 999999999 1 1 1 2 3\n"]),
        "refused entity in all groups": new + entities + node_4 + cells_4,
        "blocks without elements": new + few + node_4 + empty_blocks + b"$EndElements\n",
        "refused blocks without end": new + few + node_4
        + b"$Elements\n999999999999 2 1 2\n" + two + b"$EndElements\n",
        "sections without end": b"$MeshFormat\n4.1 0 8\n$EndMeshFormat\n" + few + node_4 + cells_4
        + b"$A\n$EndA\n" * 100_000,
        "refused sections that do not end": new + b"$A\n" * 300_000,
        "blank lines": HEAD + b"\n" * 900_000 + nodes
        + b"$Elements\n2\n" + cells + b"$EndElements\n",
        "refused dollars": b"$" * 900_000,
        "refused spaces": b" " * 900_000,
        "refused one line": HEAD + b"$Nodes\n1\n" + b"1" * 900_000 + b"\n$EndNodes\n",
        "refused digits": HEAD + nodes.replace(b"1 0 0\n", b"1" + b"0" * 900_000 + b" 0 0\n"),
        "far node numbers": HEAD + nodes.replace(b"\n4 0 1", b"\n2000000000 0 1")
        + b"$Elements\n2\n" + cells.replace(b"3 4", b"3 2000000000") + b"$EndElements\n",
        "many names": HEAD + b"$PhysicalNames\n30000\n"
        + b"".join(b'2 %d "a%d"\n' % (k + 1, k) for k in many) + b"$EndPhysicalNames\n"
        + nodes + b"$Elements\n2\n" + cells + b"$EndElements\n",
        "refused name without end": HEAD + b'$PhysicalNames\n1\n2 1 "' + b"a" * 900_000
        + b"\n$EndPhysicalNames\n" + nodes + b"$Elements\n2\n" + cells + b"$EndElements\n",
    }  # fmt: skip


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
    facets = {f: groups for f, groups in facets.items() if any(f < corners for corners in sides)}
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
