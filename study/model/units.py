"""Units of stored scalars; see `study.run.store.Result` for the convention."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from fnmatch import fnmatchcase


@dataclass(frozen=True)
class Units:
    """Consistent units of a problem.

    Attributes:
        force: Unit of forces, and of forces per length on a plane body of unit thickness.
        length: Unit of lengths.
        stress: Unit of force over length squared.
    """

    force: str
    length: str
    stress: str


UNSTATED_UNITS = Units("unit force", "unit length", "unit stress")
"""Units of a problem that is stated without units, i.e. any consistent units."""
DIMENSIONLESS_UNITS = Units("1", "1", "1")
"""Units of a problem whose quantities are dimensionless."""
SI_UNITS = Units("N", "m", "Pa")
N_MM_UNITS = Units("N", "mm", "MPa")
KN_M_UNITS = Units("kN", "m", "kN/m²")


def assign_units_to_scalars(
    scalar_names: Iterable[str], quantities: Mapping[str, str], units: Units = UNSTATED_UNITS
) -> dict[str, str]:
    """Return the unit of each scalar, according to patterns of names.

    Args:
        scalar_names: Names of the scalars.
        quantities: Mapping from patterns of names, such as "force_*", to quantities ("force",
            "length" or "stress") or units. The first matching pattern applies. Scalars without a
            match are assigned no unit, which `save` rejects.
        units: Units of force, length and stress.
    """
    scalar_units = {}
    for name in scalar_names:
        matches = (quantities[pattern] for pattern in quantities if fnmatchcase(name, pattern))
        quantity = next(matches, None)
        if quantity is not None:
            scalar_units[name] = vars(units).get(quantity, quantity)
    return scalar_units


def assign_unit_one_to_scalars(scalar_names: Iterable[str]) -> dict[str, str]:
    """Return the unit "1" for each scalar, e.g. for ratios, relative errors, orders and counts."""
    return dict.fromkeys(scalar_names, "1")
