"""Free vibration by central differences with lumped mass."""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from study.publish.plots.style import FULL, LOOK
from study.run.store import Results

SECTION = "V9"
SERIES = {
    "pw-lumped": ("new stiffness, unsymmetric", "pw-T6"),
    "pwsym-lumped": ("its symmetric part", "pwsym-T6"),
    "galerkin-lumped": ("standard stiffness", "galerkin-T6"),
}
NEEDS = [f"V9/{case}" for case in SERIES]
SHOWN = 20  # every so many steps


def draw(results: Results) -> Figure:
    """Panels: the spectra in the complex plane, displacements over time."""
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
    spectrum.set(title="(a) spectrum", xlabel=r"Re $\omega^2$", ylabel=r"Im $\omega^2$")
    motion.set(title="(b) free vibration", xlabel="time / slowest period")
    motion.set_ylabel("displacement / initial one")
    motion.legend(fontsize=7)
    return fig


def caption(results: Results) -> str:
    """What the figure shows."""
    growth = results.scalar("V9/pw-lumped", "growth_per_step")
    return (
        "Clamped square with the new element's lumped mass. (a) All eigenvalues: in the upper "
        "spectrum those of the unsymmetric stiffness leave the real axis. (b) Largest displacement "
        "in a free vibration by central differences with half the stable time step; the "
        f"fastest-growing component gains {100 * growth:.2g} % per step."
    )


def alt(results: Results) -> str:
    """The figure in words."""
    size = results.scalar("V9/pw-lumped", "amplification")
    return (
        "Eigenvalues of the symmetric pairs on the real axis, those of the unsymmetric one around "
        f"it. Displacements of the former stay of size one, those of the latter grow to {size:.0e}."
    )
