"""Units of stored scalars, see `study.run.store.Result` for the convention."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from fnmatch import fnmatchcase


@dataclass(frozen=True)
class Units:
    """Consistent units of one problem.

    Attributes:
        force: Also of the force per length on a plane body, whose thickness is one unit length.
        length: As it says.
        stress: Force over length squared.
    """

    force: str
    length: str
    stress: str


UNSTATED = Units("unit force", "unit length", "unit stress")
"""Of a problem that states none: all consistent ones will do."""
NONE = Units("1", "1", "1")
"""Of a problem whose quantities are made dimensionless."""
SI = Units("N", "m", "Pa")
N_MM = Units("N", "mm", "MPa")
KN_M = Units("kN", "m", "kN/m²")


def units_of(
    scalars: Iterable[str], kinds: Mapping[str, str], units: Units = UNSTATED
) -> dict[str, str]:
    """Return the unit of each scalar.

    Args:
        scalars: Their names.
        kinds: For patterns of names, like "force_*", what the scalar is: "force", "length" or
            "stress", else its unit itself. The first pattern that matches counts; a scalar that
            none matches gets no unit, which `save` refuses.
        units: Of force, length and stress.
    """
    found = {}
    for name in scalars:
        kind = next((kinds[pattern] for pattern in kinds if fnmatchcase(name, pattern)), None)
        if kind is not None:
            found[name] = vars(units).get(kind, kind)
    return found


def dimensionless(scalars: Iterable[str]) -> dict[str, str]:
    """Return the unit "1" for each scalar: for ratios, relative errors, orders, counts, flags."""
    return dict.fromkeys(scalars, "1")
