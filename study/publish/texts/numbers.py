"""Format numbers for texts in HTML."""

import math
from collections.abc import Callable

from markupsafe import Markup

THIN_SPACE = "\N{NARROW NO-BREAK SPACE}"
DASH = "\N{EN DASH}"


def format_number(x: float | None, digits: int = 4) -> Markup:
    """Format a number with a fixed number of significant digits, including trailing zeros.

    Very small and large numbers are written with powers of ten; None and NaN give a dash.
    """
    return _format_significant(x, digits, keep_zeros=True)


def format_short_number(x: float | None, digits: int = 6) -> Markup:
    """Format a number with at most `digits` significant digits, without trailing zeros."""
    return _format_significant(x, digits, keep_zeros=False)


def format_percent(x: float | None, digits: int = 2) -> Markup:
    """Format a fraction in per cent, with a fixed number of significant digits."""
    return format_number(None if x is None else 100 * x, digits) + (
        "" if x is None else f"{THIN_SPACE}%"
    )


def format_upper_bound(x: float | None, digits: int = 2) -> Markup:
    """Format a number rounded up to `digits` significant digits."""
    return format_number(x if x is None else _round_to_digits_by(x, digits, math.ceil), digits)


def format_lower_bound(x: float | None, digits: int = 3) -> Markup:
    """Format a number rounded down to `digits` significant digits."""
    return format_number(x if x is None else _round_to_digits_by(x, digits, math.floor), digits)


def format_decimals(x: float | None, decimals: int) -> Markup:
    """Format a number with a fixed number of digits after the decimal point."""
    if x is None or not math.isfinite(x):
        return Markup(DASH)
    text = f"{x:.{decimals}f}"
    return Markup(
        _replace_hyphen_by_minus_sign(text if float(text) else text.lstrip("-"))
    )  # no "-0.00"


def format_count(x: float | None) -> Markup:
    """Format a number as an integer, with thin spaces between thousands."""
    if x is None or not math.isfinite(x):
        return Markup(DASH)
    return Markup(_replace_hyphen_by_minus_sign(f"{x:,.0f}".replace(",", THIN_SPACE)))


def _format_significant(x: float | None, digits: int, keep_zeros: bool) -> Markup:
    if x is None or not math.isfinite(x):
        return Markup(DASH)
    if x == 0:
        return Markup("0")
    mantissa, _, exponent_text = f"{x:.{digits - 1}e}".partition("e")
    exponent = int(exponent_text)
    scientific = not -4 < exponent < max(digits, 4)
    text = (
        mantissa
        if scientific
        else f"{float(f'{mantissa}e{exponent_text}'):.{_count_decimals(exponent, digits)}f}"
    )
    if not keep_zeros and "." in text:
        text = text.rstrip("0").rstrip(".")
    text = _replace_hyphen_by_minus_sign(text)
    if not scientific:
        return Markup(text)
    return Markup(
        f"{text}{THIN_SPACE}×{THIN_SPACE}10<sup>{_replace_hyphen_by_minus_sign(str(exponent))}</sup>"
    )


def _round_to_digits_by(x: float, digits: int, round_to_integer: Callable[[float], int]) -> float:
    if x == 0 or not math.isfinite(x):
        return x
    unit = 10.0 ** (math.floor(math.log10(abs(x))) - digits + 1)
    n_units = round(x / unit, 6)  # removes round-off from integers
    return round_to_integer(n_units) * unit


def _count_decimals(exponent: int, digits: int) -> int:
    return max(digits - 1 - exponent, 0)


def _replace_hyphen_by_minus_sign(text: str) -> str:
    return text.replace("-", "\N{MINUS SIGN}")
