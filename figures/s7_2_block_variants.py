"""How far the block's answer moves with what had to be reconstructed."""

import matplotlib.pyplot as plt
from matplotlib.figure import Figure

from figures.style import FULL, LOOK
from study.core.store import Results
from study.judge import measures

SECTION = "7.2"
VARIANTS = {
    "pw-T6-80x40": "as assumed",
    "pw-T6-pull0.15-80x40": "t/p = 0.15",
    "pw-T6-pull0.40-80x40": "t/p = 0.40",
    "pw-T6-mu0.5-pull0.50-80x40": "μ = 0.5, t/p = 0.50",
    "pw-T6-together-80x40": "pressed and pulled at once",
    "pw-T6-smooth": "shared node smooth (20 × 10)",
    "pw-T6-strain": "plane strain (20 × 10)",
}
NEEDS = [f"7.2/{case}" for case in VARIANTS]
# all of one element, the new T6: none of these colours is another element's
SHADES = (LOOK["pw-T6"]["color"], "#111111", "#8A8A8A", "#B3003C", "#7FA800", "#111111", "#8A8A8A")


def draw(results: Results) -> Figure:
    """Pressure and shear of the new element in each variant."""
    fig, axes = plt.subplots(1, 2, figsize=(FULL, 2.9))
    for number, (case, label) in enumerate(VARIANTS.items()):
        curves = results.curves(f"7.2/{case}")
        style = {"linewidth": 2.0 if number == 0 else 1.1, "linestyle": "-" if number < 5 else "--"}
        for ax, name in zip(axes, ("pressure", "shear"), strict=True):
            values = curves[name] / measures.BLOCK_PRESSURE
            ax.plot(curves["x"], values, label=label, color=SHADES[number], **style)
    axes[0].set(ylabel="normal pressure / $p$", ylim=(0.7, 1.6))
    axes[1].set_ylabel("shear stress / $p$")
    for ax in axes:
        ax.set(xlabel="$x$", xlim=(0, 4))
    handles, labels = axes[0].get_legend_handles_labels()
    fig.legend(handles, labels, loc="outside lower center", ncols=3, fontsize=7)
    return fig


def caption(results: Results) -> str:
    """What the figure shows."""
    stick = ", ".join(
        f"{results.scalar(f'7.2/{case}', 'stick_to'):.3f} ({label})"
        for case, label in VARIANTS.items()
    )
    return (
        "Own-function stresses of the new element as the reconstructed data are varied; peaks at "
        f"the ends are cut off. Sticking ends at x = {stick}."
    )


def alt(results: Results) -> str:
    """The figure in words."""
    return (
        "Curves of pressure and shear over x for seven variants; they differ in where sliding "
        "begins and by some ten per cent in pressure."
    )
