"""Numbers of the paper's examples without exact values, and meshes for their uncertainties.

Each number is computed on three meshes, with the new and with the standard triangle. The list of
numbers, the meshes and the criterion for the asymptotic range (`study.judge.grid_convergence`) were
written down before the values were computed. The list excludes

- numbers with an exact value or limit: the reactions of section 7.1, sums of forces that follow
  from equilibrium, the ratio of mid-side and corner forces (1 and 2 under an even pressure), the
  buckling of the strip under a uniform load;
- differences of two computations in per cent, which are themselves estimates of an error;
- statistics over models, such as the odds of section 7.6.
"""

from dataclasses import dataclass
from typing import Literal

from study.judge.grid_convergence import GridConvergence, grid_convergence
from study.judge.measures.general import curve_at
from study.run.store import Results

Element = Literal["new", "standard"]
Keys = tuple[str, str, str]


@dataclass(frozen=True)
class SeriesQuantity:
    """Number that is computed on three meshes with the new and with the standard element.

    Attributes:
        section: Section of the paper.
        words: Name and unit in Markdown.
        name: Name of the stored scalar, or of the curve to evaluate at `position`.
        new: Keys of the new element's cases, from the coarse to the fine mesh.
        standard: Keys of the standard element's cases, from the coarse to the fine mesh.
        refinements: Divisions of a side, divided by those of the coarse mesh, (3,).
        unit: Value by which the number is divided for display.
        position: Position along the contact surface if the number is interpolated from a curve.
    """

    section: str
    words: str
    name: str
    new: Keys
    standard: Keys
    refinements: tuple[int, int, int]
    unit: float = 1.0
    position: float | None = None

    def estimate_convergence(self, results: Results, element: Element) -> GridConvergence:
        """Estimate the convergence of the number for the "new" or the "standard" element."""
        keys = self.new if element == "new" else self.standard
        values = [self._read_value(results, key) / self.unit for key in keys]
        return grid_convergence(values, [1 / refinement for refinement in self.refinements])

    def _read_value(self, results: Results, key: str) -> float:
        if self.position is None:
            return results.scalar(key, self.name)
        return curve_at(results, key, self.name, self.position)


def _case_keys_of_series(section: str, element: str, suffixes: tuple[str, str, str]) -> Keys:
    coarse, medium, fine = (f"{section}/{element}{suffix}" for suffix in suffixes)
    return coarse, medium, fine


def _make_series_quantity(
    section: str,
    words: str,
    name: str,
    suffixes: tuple[str, str, str],
    refinements: tuple[int, int, int],
    *,
    unit: float = 1.0,
    position: float | None = None,
    elements: tuple[str, str] = ("pw-T6", "galerkin-T6"),
) -> SeriesQuantity:
    new, standard = (_case_keys_of_series(section, element, suffixes) for element in elements)
    return SeriesQuantity(section, words, name, new, standard, refinements, unit, position)


HALVED_TWICE = (1, 2, 4)
BLOCK_MESHES = ("", "-40x20", "-80x40")
BLOCK_PRESSURE = 200.0
PUNCH_MESHES, PUNCH_REFINEMENTS = ("", "-57x12", "-114x24"), (1, 3, 6)
SMOOTH_PUNCH_MESHES = ("-mu0", "-mu0-57x12", "-mu0-114x24")
PLATE_MESHES = ("", "-refined2", "-refined4")
SMOOTH_PLATE_MESHES = ("-mu0", "-mu0-refined2", "-mu0-refined4")
STRAIN_PLATE_MESHES = ("-strain", "-strain-refined2", "-strain-refined4")
BEAM_MESHES = ("", "-point-10x4", "-point-20x8")
FINE_BEAM_MESHES = ("-point-20x8", "-point-40x16", "-point-80x32")
# New and standard element of each row, by its label: both with form G, or the symmetrised new
# element with the standard one in form J
BEAM_PAIRS = {
    "G": ("pw-T6", "galerkin-T6"),
    "sym., J": ("pwsym-T6", "galerkin-T6-J"),
}

QUANTITIES = [
    *(
        _make_series_quantity("7.2", words, name, BLOCK_MESHES, HALVED_TWICE)
        for words, name in (("sticks from $x$", "stick_from"), ("sticks to $x$", "stick_to"))
    ),
    *(
        _make_series_quantity(
            "7.2",
            f"pressure/$p$, $x$ = {x:g}",
            "pressure",
            BLOCK_MESHES,
            HALVED_TWICE,
            unit=BLOCK_PRESSURE,
            position=x,
        )
        for x in (0.5, 1.0, 2.0, 3.0, 3.5)
    ),
    *(
        _make_series_quantity("7.3", words, name, meshes, PUNCH_REFINEMENTS)
        for words, name, meshes in (
            (r"force, $\mu = 0.6$", "force_indentation", PUNCH_MESHES),
            (r"force, $\mu = 0$", "force_indentation", SMOOTH_PUNCH_MESHES),
            ("peak pressure", "peak_pressure", PUNCH_MESHES),
            ("shift of the punch", "translation", PUNCH_MESHES),
        )
    ),
    *(
        _make_series_quantity("7.4", words, name, meshes, HALVED_TWICE, unit=unit)
        for words, name, meshes, unit in (
            ("sticks to $x/b$, stress", "stick_to", PLATE_MESHES, 1.0),
            ("sticks to $x/b$, strain", "stick_to", STRAIN_PLATE_MESHES, 1.0),
            (r"settlement, $\mu = 0.36$, μm", "translation", PLATE_MESHES, 1e-6),
            (r"settlement, $\mu = 0$, μm", "translation", SMOOTH_PLATE_MESHES, 1e-6),
        )
    ),
    _make_series_quantity(
        "7.4",
        "pressure, $x/b$ = 0.875, kN/m²",
        "pressure",
        PLATE_MESHES,
        HALVED_TWICE,
        position=0.875,
    ),
    *(
        SeriesQuantity(
            "7.5",
            words,
            name,
            ("7.5/pw-T6", "7.5/pw-T6-fine", "7.5/pw-T6-refined4"),
            ("7.5/galerkin-T6", "7.5/galerkin-T6-refined2", "7.5/galerkin-T6-refined4"),
            HALVED_TWICE,
            unit,
        )
        for words, name, unit in (
            *((f"force $F_{k}$, kN", f"force_normal_{k}", 1.0) for k in (1, 2, 3, 4)),
            (r"$\lambda_1$, 1000/s²", "omega2_1", 1.0),
            *((rf"$\lambda_{mode}/10^6$, 1000/s²", f"omega2_{mode}", 1e6) for mode in range(2, 7)),
        )
    ),
    *(
        _make_series_quantity(
            "7.6",
            rf"$\sigma_{mode}$, MPa: {words}, {squares}",
            f"sigma_cr_{mode}",
            meshes,
            HALVED_TWICE,
            unit=1e6,
            elements=elements,
        )
        for words, elements in BEAM_PAIRS.items()
        for meshes, squares in ((BEAM_MESHES, "5 × 2"), (FINE_BEAM_MESHES, "20 × 8"))
        for mode in (1, 2)
    ),
]
"""Numbers whose uncertainties are estimated, in the order of the sections."""


@dataclass(frozen=True)
class QuantityConvergence:
    """Convergence of a number with the new element (`new`) and the standard one (`standard`)."""

    quantity: SeriesQuantity
    new: GridConvergence
    standard: GridConvergence


def estimate_convergence_of_quantities(results: Results) -> list[QuantityConvergence]:
    """Return the convergence of all `QUANTITIES`, computed from stored results."""
    return [
        QuantityConvergence(
            quantity,
            quantity.estimate_convergence(results, "new"),
            quantity.estimate_convergence(results, "standard"),
        )
        for quantity in QUANTITIES
    ]
