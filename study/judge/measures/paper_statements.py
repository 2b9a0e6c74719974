"""Measures of statements that the paper makes in passing: cost, and the shear of its Fig. 10."""

from typing import Literal

import numpy as np
import numpy.typing as npt

from study.core.store import Results

Array = npt.NDArray[np.float64]

FINE_PUNCH = "7.3/pw-T6-114x24"
SAMPLES = 20_001  # of its shear, some 90 from node to node


def factor_entries_ratio(results: Results, key: str, other: str) -> float:
    """Entries of the factors of one case's matrix over those of another one's."""
    return results.scalar(key, "entries") / results.scalar(other, "entries")


def shear_off_fine(
    results: Results,
    key: str,
    within: float,
    kind: Literal["largest", "rms"] = "largest",
    averaged_on: str = "",
) -> float:
    """Shear below the punch of section 7.3 against the fine mesh's, read by the same functions.

    A node's shear is its force over the integral of its own test function; the fine mesh's is
    averaged with that function. Nodes in |x| < `within`; in per cent of the fine mesh's largest
    shear. `averaged_on` names a coarser case, with whose functions both are averaged.
    """
    ours, fine, case = results.curves(key), results.curves(FINE_PUNCH), results[averaged_on or key]
    nodes, standard = case.curves["x"], case.parameters["element"].startswith("galerkin")
    x = np.linspace(fine["x"][0], fine["x"][-1], SAMPLES)
    weights = _test_functions(nodes, x, standard)

    def averaged(line: dict[str, Array]) -> Array:
        return weights @ np.interp(x, line["x"], line["shear"]) / weights.sum(axis=1)

    off = (averaged(ours) if averaged_on else ours["shear"]) - averaged(fine)
    off = off[np.abs(nodes) < within]
    size = np.abs(off).max() if kind == "largest" else np.sqrt(np.mean(off**2))
    return float(100 * size / np.abs(fine["shear"]).max())


def _test_functions(nodes: Array, x: Array, standard: bool) -> Array:
    """Test functions (m, n) of nodes (m,) along a line, at places (n,): quadratic ones, or hats."""
    if not standard:
        return np.array([np.interp(x, nodes, unit) for unit in np.eye(len(nodes))])
    corners = nodes[::2]
    hats = np.array([np.interp(x, corners, unit) for unit in np.eye(len(corners))])
    functions = np.empty((len(nodes), len(x)))
    functions[1::2] = 4 * hats[:-1] * hats[1:]
    functions[::2] = hats
    functions[2::2] -= functions[1::2] / 2
    functions[:-1:2] -= functions[1::2] / 2
    return functions


# Section, and the scalar of mid-side over corner force
_EXAMPLES = [(section, "sawtooth") for section in ("7.2", "7.3", "7.4")]
_EXAMPLES += [("7.5", f"sawtooth_{surface}") for surface in (1, 2, 3, 4)]
_STANDARD = ("galerkin-T6", "galerkin-Q8")


def corner_share_in_examples(results: Results) -> float:
    """Corner over mid-side force of the standard elements, where it is farthest from a half."""
    shares = [
        1 / results.scalar(f"{section}/{element}", name)
        for section, name in _EXAMPLES
        for element in _STANDARD
    ]
    return max(shares, key=lambda share: abs(share - 0.5))


def unevenness_of_standard(results: Results) -> float:
    """Largest unevenness of the standard elements' pressure over the node's own test function.

    Plane examples; in per cent of the pressure.
    """
    plane = [section for section, _ in _EXAMPLES if section != "7.5"]
    return 100 * max(
        results.scalar(f"{section}/{element}", "unevenness")
        for section in plane
        for element in _STANDARD
    )
