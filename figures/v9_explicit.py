"""Free vibration by central differences with lumped mass."""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from figures.style import FULL, LOOK
from study.core.store import Results

SECTION = "V9"
SERIES = {
    "pw-lumped": ("new stiffness, unsymmetric", "pw-T6"),
    "pwsym-lumped": ("its symmetric part", "pwsym-T6"),
    "galerkin-lumped": ("standard stiffness", "galerkin-T6"),
}
NEEDS = [f"V9/{case}" for case in SERIES]
SHOWN = 20  # every so many steps


def draw(results: Results) -> Figure:
    """Left the spectra in the complex plane, right displacements over time."""
    fig, (spectrum, motion) = plt.subplots(1, 2, figsize=(FULL, 2.6))
    for case, (label, look) in SERIES.items():
        curves = results.curves(f"V9/{case}")
        color = LOOK[look]["color"]
        spectrum.plot(curves["real"], curves["imaginary"], ".", color=color, ms=3, label=label)
        # the largest displacement within each stretch, so that no maximum is passed over
        starts = np.arange(0, len(curves["time"]), SHOWN)
        envelope = np.maximum.reduceat(curves["amplitude"], starts)
        dashes = "--" if case == "galerkin-lumped" else "-"
        motion.semilogy(curves["time"][starts], envelope, dashes, color=color, lw=1.2, label=label)
    spectrum.set(xlabel="Re ω²", ylabel="Im ω²")
    motion.set(xlabel="time / slowest period", ylabel="largest displacement / initial one")
    motion.legend(fontsize=7)
    return fig


def caption(results: Results) -> str:
    """What the figure shows."""
    growth = results.scalar("V9/pw-lumped", "growth_per_step")
    return (
        "Clamped square with the new element's lumped mass. Left: all eigenvalues; those of the "
        "unsymmetric stiffness leave the real axis in the upper spectrum. Right: free vibration by "
        f"central differences at half the stable step; {100 * growth:.2g} % a step is the largest "
        "growth of a part of it."
    )


def alt(results: Results) -> str:
    """The figure in words."""
    size = results.scalar("V9/pw-lumped", "amplification")
    return (
        "Eigenvalues of the symmetric pairs on the real axis, those of the unsymmetric one around "
        f"it. Displacements of the former stay of size one, those of the latter grow to {size:.0e}."
    )
