"""Numbers of README's example and of a contact problem with friction, for `.ci/pip`.

    python3 pip_numbers.py FILE                      compute them, and write them to a file
    python3 pip_numbers.py --compare FILE FILE ...   compare the files with the first one

README.md has to be in the folder of this script, so that the example is that of the checkout.
"""

import json
import math
import re
import sys
from pathlib import Path
from typing import Any

TOLERANCE = 1e-9  # of the largest number in an array


def compute_numbers(file: Path) -> None:
    """Write the arrays to a file, as lists by name, with versions and the number of processes."""
    readme = Path(__file__).with_name("README.md").read_text("utf-8")
    example: dict[str, Any] = {}
    exec(re.search(r"```python\n(.*?)```", readme, re.DOTALL)[1], example)

    from mpi4py import MPI

    import dolfinx
    import numpy as np

    import pw_elements
    from pw_elements import Body, Material, Reduction, Spaces, assemble_matrix, prescribe
    from pw_elements.contact import ContactPair, Motion, Plane, solve_contact
    from pw_elements.meshes import quadrilaterals

    block = quadrilaterals(MPI.COMM_WORLD, (0, 0), (4, 2), (16, 8))
    body = Body(Spaces.petrov_galerkin(block), Material(1000.0, 0.3), "plane strain")
    U = body.spaces.trial
    K = assemble_matrix(body.stiffness())
    base = [prescribe(U, i, lambda x: np.isclose(x[1], 0)) for i in (0, 1)]
    motions = [Motion((x, None), force=(0, -20)) for x in (0, 0.002, 0.01, 0)]
    plate = ContactPair(lambda x: np.isclose(x[1], 2), Plane((0, 2), (0, -1)), 0.3, motions)
    held = Reduction.dirichlet(U, base)
    states = solve_contact(K, [K.createVecLeft()] * len(motions), held, plate, U)

    numbers = {"README's example": [example["a"].norm(), example["a"].max()[1]]}
    for number, state in enumerate(states):
        for name in ("force_normal", "force_tangential", "slip", "translation"):
            values = getattr(state.pairs[0], name)
            numbers[f"increment {number}, {name}"] = values.ravel().tolist()
    if MPI.COMM_WORLD.rank == 0:
        label = f"{pw_elements.__path__[0]} {pw_elements.__version__}"
        label += f" with {dolfinx.__path__[0]} {dolfinx.__version__}"
        label += f", {MPI.COMM_WORLD.size} process(es)"
        file.write_text(json.dumps({"label": label, "numbers": numbers}), "utf-8")


def compare_numbers(files: list[Path]) -> int:
    """Print the largest relative difference of each file; return 1 if one is too large."""
    reference, *others = (json.loads(file.read_text("utf-8")) for file in files)
    print("==", reference["label"])
    is_different = False
    for other in others:
        assert other["numbers"].keys() == reference["numbers"].keys()
        differences = {}
        for name, expected in reference["numbers"].items():
            pairs = zip(expected, other["numbers"][name], strict=True)
            errors = [abs(a - b) for a, b in pairs]
            largest = math.inf if any(map(math.isnan, errors)) else max(errors, default=0.0)
            differences[name] = largest / (max(map(abs, expected), default=0.0) or 1.0)
        worst = max(differences, key=differences.__getitem__)
        print(f"== {other['label']}: differs by at most {differences[worst]:.1e} ({worst})")
        is_different |= differences[worst] > TOLERANCE
    return int(is_different)


if __name__ == "__main__":
    if sys.argv[1] == "--compare":
        sys.exit(compare_numbers([Path(name) for name in sys.argv[2:]]))
    compute_numbers(Path(sys.argv[1]))
