"""Critical stresses, printed and computed."""

import matplotlib.pyplot as plt
from matplotlib.figure import Figure

from figures.style import ELEMENT_LOOK, PAGE_WIDTH
from study.paper.items import TABLE_2
from study.run.store import Results

SECTION = "7.6"
COMPUTED_LABELS = {
    "galerkin-T6-J": "standard T6, form J",
    "galerkin-T6": "standard T6, form G",
    "pw-T6": "new T6, form G",
    "pwsym-T6": "new T6 symmetrised, form G",
    "galerkin-Q8-J": "standard Q8, form J",
    "galerkin-Q8": "standard Q8, form G",
    "composite-T6-J": "composite T6, form J",
    "composite-T6": "composite T6, form G",
}
EXACT_LABELS = {
    "J": "exact, form J",
    "G": "exact, form G",
    "engesser": "Engesser",
    "euler": "Euler",
}
NEEDS = ["7.6/exact", *(f"7.6/{case}" for case in COMPUTED_LABELS)]


def draw(results: Results) -> Figure:
    """Plot printed, computed and exact critical stresses, with one panel per mode."""
    fig, axes = plt.subplots(1, 2, figsize=(PAGE_WIDTH, 3.3), sharey=True)
    labels: list[str] = []
    for mode, ax in enumerate(axes, start=1):
        rows = [
            (f"printed: {name}", stresses[mode - 1], "black", "*")
            for name, stresses in TABLE_2.items()
        ]
        for case, label in COMPUTED_LABELS.items():
            look = ELEMENT_LOOK[results[f"7.6/{case}"].parameters["element"]]
            value = results.scalar(f"7.6/{case}", f"sigma_cr_{mode}")
            rows.append((label, value, look["color"], look["marker"]))
        for name, label in EXACT_LABELS.items():
            rows.append((label, results.scalar("7.6/exact", f"{name}_{mode}"), "black", "|"))
        for row_number, (_, value, color, marker) in enumerate(rows):
            size = 9 if marker == "|" else 7 if marker == "*" else 5
            ax.plot(value / 1e9, row_number, marker, color=color, markersize=size)
            ax.annotate(
                f"{value / 1e9:.4f}",
                (1.01, row_number),
                xycoords=("axes fraction", "data"),
                va="center",
                fontsize=7,
            )
        labels = [row[0] for row in rows]
        ax.set(title=f"mode {mode}", xlabel="critical stress / GPa")
        for border_row in (len(TABLE_2), len(TABLE_2) + len(COMPUTED_LABELS)):
            ax.axhline(border_row - 0.5, color="#999999", linewidth=0.6)
    axes[0].set_yticks(range(len(labels)), labels)
    axes[0].invert_yaxis()
    return fig


def caption(results: Results) -> str:
    """Return the caption."""
    return (
        "Printed values (stars), the same quantities computed on the reconstructed mesh of 5 × "
        "2 crossed squares under the point load, and exact values for a uniform stress (bars)."
    )


def alt(results: Results) -> str:
    """Return a description for readers who do not see the figure."""
    return (
        "Dots of the critical stress, a row a value, for modes 1 and 2. The printed CPS6 lies at "
        "the exact value of form J, the printed user element a little above that of form G."
    )
