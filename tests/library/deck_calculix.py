"""Results of CalculiX for the decks of `deck_models`: `python3 -m tests.library.deck_calculix`.

The script needs Python, NumPy and `ccx` (Debian's calculix-ccx), and it writes
`deck_calculix.json`. For each deck, the file has a digest, the volumes of the elements, and the
members of the sets.
"""

import hashlib
import json
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from tests.library.deck_models import DECK_MODELS

ANSWERS = Path(__file__).with_suffix(".json")
ELSETS = ("LEFT", "RIGHT", "BOTH", "SOME")
NSETS = ("ALL", "BOTTOM", "EVERYTHING")


def executable():
    return shutil.which("ccx")


def digest(kind):
    return hashlib.sha256(DECK_MODELS[kind].encode()).hexdigest()


def compute(kind, ccx):
    """Return the volumes of elements by number, and the members of each set, from CalculiX."""
    section = {"S": "SHELL", "M": "MEMBRANE"}.get(kind[0], "SOLID")
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
    step += "".join(f"*EL PRINT,ELSET={name}\nEVOL\n" for name in ELSETS)
    step += "".join(f"*NODE PRINT,NSET={name}\nU\n" for name in NSETS)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "deck.inp").write_text(f"{DECK_MODELS[kind]}{step}*END STEP\n", newline="")
        run = subprocess.run([ccx, "deck"], cwd=folder, capture_output=True, text=True)
        if run.returncode:
            raise RuntimeError(f"{kind}: CalculiX failed:\n{run.stdout}")
        printed = (folder / "deck.dat").read_text()
    volumes, sets = {}, {}
    for line in printed.splitlines():
        if match := re.match(r" (?:volume|displacements) .* for set (\w+)", line):
            name = match[1]
            members = sets.setdefault(name, [])
        elif line.strip():
            number, value, *_ = line.split()
            members.append(int(number))
            if name in ELSETS:
                volumes[number] = float(value)
    sets = {name: sorted(set(members)) for name, members in sets.items()}
    return {"sha256": digest(kind), "volumes": volumes, "sets": sets}


def main():
    if executable() is None:
        sys.exit("CalculiX (ccx, Debian's calculix-ccx) is not installed")
    rows = [f'"{kind}": {json.dumps(compute(kind, executable()))}' for kind in DECK_MODELS]
    ANSWERS.write_text("{\n" + ",\n".join(rows) + "\n}\n")


if __name__ == "__main__":
    main()
