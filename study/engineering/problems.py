"""Meshes and readings of the problems of section W; needs no DOLFINx."""

MESHES = {
    "wear": {"T6": (4, 8), "T10": (4, 8)},
    "friction": {"T6": (4, 8), "T10": (3, 5)},
    "conductance": {"T6": (4, 8), "T10": (3, 5)},
    "impact": {"T6": (4, 8), "T10": (4, 8)},
    "submodel": {"T6": (4, 8), "T10": (3, 5)},
}
FINE = {
    "wear": {"T6": 32, "T10": 12},
    "friction": {"T6": 32, "T10": 8},
    "impact": {"T6": 32, "T10": 16},
}
"""Cells along the punch's height, edges over the contact's half width, cells along the block's."""
_READINGS: dict[tuple[str, str], tuple[str, ...]] = {
    ("wear", "pw-T6"): ("own", "projected"),
    ("wear", "pw-T10"): ("own", "projected"),
    ("wear", "galerkin-T6"): ("own", "projected", "tributary"),
    ("wear", "galerkin-T10"): ("projected", "skip", "neighbours", "tributary"),
    ("friction", "pw-T6"): ("own",),
    ("friction", "pw-T10"): ("own",),
    ("friction", "galerkin-T6"): ("own", "tributary"),
    ("friction", "galerkin-T10"): ("projected", "skip", "tributary"),
}


def elements(problem: str, cell: str) -> tuple[str, str]:
    """The standard element and the new one, in dynamics its symmetric sibling."""
    return f"galerkin-{cell}", f"{'sibling' if problem == 'impact' else 'pw'}-{cell}"


def readings(problem: str, element: str) -> tuple[str, ...]:
    """How pressures are read; "none" where none are."""
    if problem == "impact":
        return ("none",)
    own = "skip" if element == "galerkin-T10" else "own"
    usual = (own, "projected") + (("forces",) if problem == "submodel" else ())
    return _READINGS.get((problem, element), usual)


def names(problem: str, cell: str) -> list[tuple[str, str, int, str]]:
    """Problem, element, mesh and reading of the cases of one kind of cells, which name them."""
    return [
        (problem, element, mesh, reading)
        for element in elements(problem, cell)
        for mesh in MESHES[problem][cell]
        for reading in readings(problem, element)
    ]
