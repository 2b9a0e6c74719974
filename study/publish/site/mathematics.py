"""Mathematics in plain text, as in docstrings and claims: nu <= 1/2, K_r = L^T K R."""

import re

_LETTERS = {
    "int": "∫",
    "lambda": "λ",
    "omega": "ω",
    "sigma": "σ",
    "eps": "ε",
    "rho": "ρ",
    "mu": "μ",
    "nu": "ν",
}
_WORD = re.compile(rf"(?<![\w.])({'|'.join(_LETTERS)})(?!\w|\()")
_CALL = re.compile(r"(?<![\w.])eps(?=\()")
_SIGNS = {
    r"(?:<|&lt;)=": "≤",
    r"(?:>|&gt;)=": "≥",
    r"\bsqrt\(": "√(",
    r"(?<=\d) x (?=\d)": " × ",
    r"(?<=\d) - (?=\w)": " \N{MINUS SIGN} ",
    r"\btan a\b": "tan α",
}
_RAISED = re.compile(r"\^(-?\w+)|(?<=\b[HL])([12])\b")
_LOWERED = re.compile(r"(?<=\b[A-Za-zσω])_(\w+)|(?<=\bp)0\b")


def typeset(text: str, lowered: str = "<sub>{}</sub>", raised: str = "<sup>{}</sup>") -> str:
    """Return text with letters, signs, indices and powers in place of their spellings.

    Args:
        text: plain, or escaped for HTML.
        lowered: how an index is written.
        raised: how a power is written.
    """
    for sign, written in _SIGNS.items():
        text = re.sub(sign, written, text)
    text = _RAISED.sub(lambda m: raised.format((m[1] or m[2]).replace("-", "\N{MINUS SIGN}")), text)
    text = _LOWERED.sub(lambda m: lowered.format(_LETTERS.get(m[1], m[1] or "0")), text)
    return _CALL.sub("ε", _WORD.sub(lambda m: _LETTERS[m[1]], text))
