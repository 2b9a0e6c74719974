"""Near incompressibility: from where on the new element is worse than the standard one."""

import matplotlib.pyplot as plt
from matplotlib.figure import Figure

from study.judge import measures
from study.publish.plots.style import FULL
from study.run.store import Results

SECTION = "C"
# Setting, its label, colour, marker, nodes of the element
SETTINGS = (
    ("plane-strain", "plane strain, straight sides", "#0072B2", "o", "T6"),
    ("pressure", "plane strain, pressure alone", "#D55E00", "^", "T6"),
    ("axisymmetric", "axisymmetry, straight sides", "#B87A00", "s", "T6"),
    ("ring", "ring, curved outline", "#007A5A", "D", "T6"),
    ("curved-ring", "ring, all sides curved", "#6A4C93", "P", "T6"),
    ("solid", "cube of tetrahedra", "#B0568C", "v", "T10"),
)
NEEDS = [
    f"C/{element}-{nodes}-{case}"
    for name, _, _, _, nodes in SETTINGS
    for element in ("galerkin", "pw")
    for case in (f"nu-{name}", f"incompressible-{name}".removesuffix("-plane-strain"))
]


def draw(results: Results) -> Figure:
    """Ratio of the errors over Poisson's ratio, and both errors over h at 0.4999."""
    fig, (left, right) = plt.subplots(1, 2, figsize=(FULL, 2.4), layout="constrained")
    for name, label, color, marker, nodes in SETTINGS:
        ours, standard = (results.curves(f"C/{e}-{nodes}-nu-{name}") for e in ("pw", "galerkin"))
        look = {"color": color, "marker": marker}
        ratio = ours["error_H1"] / standard["error_H1"]
        left.loglog(0.5 - ours["nu"], ratio, label=label, **look)
        case = f"incompressible-{name}".removesuffix("-plane-strain")
        for element, line in (("pw", "-"), ("galerkin", ":")):
            curves = results.curves(f"C/{element}-{nodes}-{case}")
            face = {} if element == "pw" else {"markerfacecolor": "none"}
            right.loglog(curves["h"], curves["error_H1"], linestyle=line, **look, **face)
    nu = results.curves("C/pw-T6-nu-pressure")["nu"]
    left.set_xticks(0.5 - nu, [f"{value:g}" for value in nu], rotation=60, fontsize=7)
    left.set_xticks([], minor=True)
    left.set_yticks([1, 2, 5, 10, 20, 50], ["1", "2", "5", "10", "20", "50"])
    left.set_yticks([], minor=True)
    left.invert_xaxis()
    left.set(title="(a) H1 error of the new over the standard", xlabel="Poisson's ratio")
    left.set_ylabel("ratio of errors")
    right.set(title="(b) Poisson's ratio 0.4999", xlabel="cell size $h$")
    right.set_ylabel("relative H1 error")
    right.set_xticks([0.02, 0.05, 0.1, 0.2], ["0.02", "0.05", "0.1", "0.2"])
    right.set_xticks([], minor=True)
    right.plot([], [], "-", color="black", label="new")
    right.plot([], [], ":", color="black", label="standard")
    right.legend(loc="lower right", fontsize=7)
    fig.legend(*left.get_legend_handles_labels(), loc="outside lower center", ncols=3, fontsize=7)
    return fig


def caption(results: Results) -> str:
    """What the figure shows."""
    others = "|".join(name for name, *_ in SETTINGS if name not in ("plane-strain", "pressure"))
    worst = measures.ratio_at_poissons_ratio(results, others, "error_H1", 0.4999)
    safe = measures.ratio_at_poissons_ratio(results, f"plane-strain|{others}", "error_H1", 0.49)
    pressure, alone = (
        measures.ratio_at_poissons_ratio(results, "pressure", "error_H1", nu)
        for nu in (0.49, 0.4999)
    )
    return (
        "Error of the displacement gradient (H1) under a body force. (a) New over standard element "
        f"on one mesh. Up to ν = 0.49 the ratio is at most {safe:.2f}, or {pressure:.2f} if "
        f"pressure alone balances the body force; at 0.4999 it reaches {worst:.0f} where the "
        f"identity with T fails and stays 1 where it holds, unless pressure alone balances the "
        f"body force ({alone:.0f}). (b) Both elements over the cell size at 0.4999; an error of 1 "
        "means that the result is useless."
    )


def alt(results: Results) -> str:
    """The figure in words."""
    return (
        "Six curves of the ratio of errors over Poisson's ratio, all near one up to 0.49, "
        "five of them rising steeply towards one half; and errors over h of both elements; the "
        "new element's curves lie above the standard one's, up to an error of one and more."
    )
