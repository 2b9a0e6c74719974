"""Plain C functions from the kernels that FFCx generates.

FFCx's files need the headers of Python, of UFCx and of DOLFINx's C++ library. The functions in them
that compute an integral or evaluate an expression need none of these: their tables are constants
in the functions. Only these functions are kept, with parameters of a user element.
"""

import re
from collections.abc import Mapping, Sequence
from typing import Any

import ffcx.compiler
import ffcx.options
import ufl
from dolfinx import fem
from ufl.algorithms import extract_coefficients
from ufl.algorithms.analysis import extract_constants

from pw_elements.spaces import add_sub_cell_quadrature_rules
from pw_elements.user_element.forms import ElementForms

_FUNCTION_HEAD_PATTERN = re.compile(r"^void tabulate_tensor_\w+\([^)]*\)\s*\{\n", re.M)
_PARAMETERS = ("w", "properties", "load", "coordinate_dofs", "entity_local_index")


def generate_kernels(forms: ElementForms, prefix: str) -> dict[str, str]:
    """Return the C source of each kernel, by its name; functions are called prefix_name.

    Raises:
        RuntimeError: if FFCx generates other source text than is known.
    """
    kernels = {}
    for name, form in forms.forms.items():
        prepared = add_sub_cell_quadrature_rules(ufl.algorithms.expand_derivatives(form))
        _require_known_coefficients(prepared.coefficients(), forms.displacement)
        kernels[name] = _generate_function(
            f"{prefix}_{name}", prepared, prepared.constants(), forms.sources
        )
    for name, (expression, points) in forms.expressions.items():
        _require_known_coefficients(extract_coefficients(expression), forms.displacement)
        kernels[name] = _generate_function(
            f"{prefix}_{name}", (expression, points), extract_constants(expression), forms.sources
        )
    return kernels


def _require_known_coefficients(coefficients: Sequence[Any], displacement: fem.Function) -> None:
    assert list(coefficients) in ([], [displacement])


def _generate_function(
    name: str,
    ufl_object: Any,  # noqa: ANN401
    constants: Sequence[fem.Constant],
    sources: Mapping[fem.Constant, tuple[str, ...]],
) -> str:
    compiled = ffcx.compiler.compile_ufl_objects([ufl_object], ffcx.options.get_options())
    # FFCx 0.9 returns header and source; later versions return a list of them, and their suffixes
    _, code = compiled[0] if isinstance(compiled[0], list) else compiled
    heads = list(_FUNCTION_HEAD_PATTERN.finditer(code))
    if len(heads) != 1:
        raise RuntimeError(f"FFCx has generated {len(heads)} functions for {name}, not one")
    lines = [line.rstrip() for line in _text_before_closing_brace(code[heads[0].end() :])]
    body = "\n".join(line for line in lines if line and not line.lstrip().startswith("//"))
    if re.search(r"\b(quadrature_permutation|custom_data|ufcx_\w+)\b", body):
        raise RuntimeError(f"FFCx's function for {name} needs data that a user element has not")
    prelude = [f"(void){parameter};" for parameter in _PARAMETERS]
    if re.search(r"\bc\[", body):
        values = ", ".join(value for constant in constants for value in sources[constant])
        prelude.append(f"const double c[] = {{{values}}};")
    return "\n".join(
        [
            f"static void {name}(double* restrict A, const double* restrict w,",
            "    const double* restrict properties, const double* restrict load,",
            "    const double* restrict coordinate_dofs, const int* restrict entity_local_index)",
            "{",
            *prelude,
            body,
            "}",
        ]
    )


def _text_before_closing_brace(code: str) -> list[str]:
    """Return the lines of a block of C code, whose opening brace precedes `code`."""
    depth = 1
    for brace in re.finditer(r"[{}]", code):
        depth += 1 if brace[0] == "{" else -1
        if depth == 0:
            return code[: brace.start()].splitlines()
    raise RuntimeError("FFCx has generated a function without an end")
