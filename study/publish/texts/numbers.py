"""How the report writes numbers."""

import math
from collections.abc import Callable

from markupsafe import Markup

THIN = "\N{NARROW NO-BREAK SPACE}"
DASH = "\N{EN DASH}"


def num(x: float | None, digits: int = 4) -> Markup:
    """Write a number with so many significant digits, large and small ones with a power of ten."""
    return _written(x, digits, padded=True)


def short(x: float | None, digits: int = 6) -> Markup:
    """Write a number with at most so many significant digits, without zeros at the end."""
    return _written(x, digits, padded=False)


def pct(x: float | None, digits: int = 2) -> Markup:
    """Write a fraction in per cent, with so many significant digits."""
    return num(None if x is None else 100 * x, digits) + ("" if x is None else f"{THIN}%")


def most(x: float | None, digits: int = 2) -> Markup:
    """Write an upper bound: rounded up to so many significant digits."""
    return num(x if x is None else _rounded(x, digits, math.ceil), digits)


def least(x: float | None, digits: int = 3) -> Markup:
    """Write a lower bound: rounded down to so many significant digits."""
    return num(x if x is None else _rounded(x, digits, math.floor), digits)


def fixed(x: float | None, decimals: int) -> Markup:
    """Write a number with so many decimals."""
    if x is None or not math.isfinite(x):
        return Markup(DASH)
    text = f"{x:.{decimals}f}"
    return Markup(_signed(text if float(text) else text.lstrip("-")))  # no "-0.00"


def count(x: float | None) -> Markup:
    """Write a whole number, thousands apart."""
    if x is None or not math.isfinite(x):
        return Markup(DASH)
    return Markup(_signed(f"{x:,.0f}".replace(",", THIN)))


def _written(x: float | None, digits: int, padded: bool) -> Markup:
    if x is None or not math.isfinite(x):
        return Markup(DASH)
    if x == 0:
        return Markup("0")
    mantissa, _, power = f"{x:.{digits - 1}e}".partition("e")
    exponent = int(power)
    scientific = not -4 < exponent < max(digits, 4)
    text = (
        mantissa
        if scientific
        else f"{float(f'{mantissa}e{power}'):.{_decimals(exponent, digits)}f}"
    )
    if not padded and "." in text:
        text = text.rstrip("0").rstrip(".")
    text = _signed(text)
    if not scientific:
        return Markup(text)
    return Markup(f"{text}{THIN}×{THIN}10<sup>{_signed(str(exponent))}</sup>")


def _rounded(x: float, digits: int, towards: Callable[[float], int]) -> float:
    if x == 0 or not math.isfinite(x):
        return x
    unit = 10.0 ** (math.floor(math.log10(abs(x))) - digits + 1)
    whole = round(x / unit, 6)  # what is a whole number but for round-off stays one
    return towards(whole) * unit


def _decimals(exponent: int, digits: int) -> int:
    return max(digits - 1 - exponent, 0)


def _signed(text: str) -> str:
    return text.replace("-", "\N{MINUS SIGN}")
