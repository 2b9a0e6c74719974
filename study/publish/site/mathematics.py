"""Typeset plain-text formulas of docstrings and claims, e.g. nu <= 1/2 or K_r = L^T K R."""

import re

_SYMBOL_OF_NAME = {
    "int": "∫",
    "lambda": "λ",
    "omega": "ω",
    "sigma": "σ",
    "eps": "ε",
    "rho": "ρ",
    "mu": "μ",
    "nu": "ν",
}
_SYMBOL_NAME = re.compile(rf"(?<![\w.])({'|'.join(_SYMBOL_OF_NAME)})(?!\w|\()")
_STRAIN_OPERATOR = re.compile(r"(?<![\w.])eps(?=\()")
_SIGN_OF_PATTERN = {
    r"(?:<|&lt;)=": "≤",
    r"(?:>|&gt;)=": "≥",
    r"\bsqrt\(": "√(",
    r"(?<=\d) x (?=\d)": " × ",
    r"(?<=\d) - (?=\w)": " \N{MINUS SIGN} ",
    r"\btan a\b": "tan α",
}
_SUPERSCRIPT = re.compile(r"\^(-?\w+)|(?<=\b[HL])([12])\b")
_SUBSCRIPT = re.compile(r"(?<=\b[A-Za-zσω])_(\w+)|(?<=\bp)0\b")


def typeset_plain_text_mathematics(
    text: str, subscript_format: str = "<sub>{}</sub>", superscript_format: str = "<sup>{}</sup>"
) -> str:
    """Replace spelled-out Greek letters, operators, indices and powers by typeset symbols.

    Args:
        text: Plain text, or text escaped for HTML.
        subscript_format: Format string for an index, whose placeholder is {}.
        superscript_format: Format string for a power.
    """
    for pattern, sign in _SIGN_OF_PATTERN.items():
        text = re.sub(pattern, sign, text)
    text = _SUPERSCRIPT.sub(
        lambda m: superscript_format.format((m[1] or m[2]).replace("-", "\N{MINUS SIGN}")), text
    )
    text = _SUBSCRIPT.sub(
        lambda m: subscript_format.format(_SYMBOL_OF_NAME.get(m[1], m[1] or "0")), text
    )
    return _STRAIN_OPERATOR.sub("ε", _SYMBOL_NAME.sub(lambda m: _SYMBOL_OF_NAME[m[1]], text))
