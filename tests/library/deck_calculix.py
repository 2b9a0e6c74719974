"""Compute CalculiX's results for the decks of `deck_models`.

`python3 -m tests.library.deck_calculix` needs NumPy and `ccx` (Debian's calculix-ccx). It writes
`deck_calculix.json`, which has a digest of each deck, the volumes of its elements, and the members
of its sets.
"""

import hashlib
import json
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from tests.library.deck_models import DECKS_BY_ELEMENT_TYPE

CALCULIX_RESULTS_FILE = Path(__file__).with_suffix(".json")
PRINTED_ELEMENT_SETS = ("LEFT", "RIGHT", "BOTH", "SOME")
PRINTED_NODE_SETS = ("ALL", "BOTTOM", "EVERYTHING")


def find_calculix_executable():
    return shutil.which("ccx")


def compute_deck_sha256(element_type):
    return hashlib.sha256(DECKS_BY_ELEMENT_TYPE[element_type].encode()).hexdigest()


def compute_volumes_and_sets_by_calculix(element_type, ccx_path):
    """Run CalculiX, and return the volumes of elements by number and the members of each set.

    The dictionary also has the digest of the deck ("sha256").
    """
    section = {"S": "SHELL", "M": "MEMBRANE"}.get(element_type[0], "SOLID")
    step = f"""*ELSET,ELSET=SECTION
LEFT,RIGHT
*MATERIAL,NAME=M
*ELASTIC
1.,.3
*{section} SECTION,ELSET=SECTION,MATERIAL=M
1.
*BOUNDARY
ALL,1,2
*STEP
*STATIC
"""
    step += "".join(f"*EL PRINT,ELSET={name}\nEVOL\n" for name in PRINTED_ELEMENT_SETS)
    step += "".join(f"*NODE PRINT,NSET={name}\nU\n" for name in PRINTED_NODE_SETS)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "deck.inp").write_text(
            f"{DECKS_BY_ELEMENT_TYPE[element_type]}{step}*END STEP\n", newline=""
        )
        run = subprocess.run([ccx_path, "deck"], cwd=folder, capture_output=True, text=True)
        if run.returncode:
            raise RuntimeError(f"{element_type}: CalculiX failed:\n{run.stdout}")
        printed = (folder / "deck.dat").read_text()
    volumes, sets = {}, {}
    for line in printed.splitlines():
        if match := re.match(r" (?:volume|displacements) .* for set (\w+)", line):
            name = match[1]
            members = sets.setdefault(name, [])
        elif line.strip():
            number, value, *_ = line.split()
            members.append(int(number))
            if name in PRINTED_ELEMENT_SETS:
                volumes[number] = float(value)
    sets = {name: sorted(set(members)) for name, members in sets.items()}
    return {"sha256": compute_deck_sha256(element_type), "volumes": volumes, "sets": sets}


def write_calculix_results():
    executable = find_calculix_executable()
    if executable is None:
        sys.exit("CalculiX (ccx, Debian's calculix-ccx) is not installed")
    rows = [
        f'"{kind}": {json.dumps(compute_volumes_and_sets_by_calculix(kind, executable))}'
        for kind in DECKS_BY_ELEMENT_TYPE
    ]
    CALCULIX_RESULTS_FILE.write_text("{\n" + ",\n".join(rows) + "\n}\n")


if __name__ == "__main__":
    write_calculix_results()
