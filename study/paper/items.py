"""Figures, tables and numbered equations of the paper: printed numbers, and files that use them.

M. Klisiński, Ch. Luo, E. Postek, "Discussion on application of piece-wise linear weight
functions in 2D contact problems", received August 16, 2001.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from study.run.cases import SECTIONS, find_page_source, title
from study.run.pages import read_literal_constants, section_sort_key

# Critical stresses of modes 1 and 2 in Pa, as printed in Table 2 and below Eq. (27)
TABLE_2: dict[str, tuple[float, ...]] = {
    "Euler": (2660e6, 10640e6),
    "CPS6": (2.6208e9, 9.8096e9),
    "CPS6M": (2.6105e9, 9.6683e9),
    "6-node user element": (2.5608e9, 9.1833e9),
}

# The first six eigenvalues as printed in Table 1, without units
TABLE_1: dict[str, tuple[float, ...]] = {
    "CAX6": (36389.0, 1.9319e6, 3.8114e6, 3.9787e6, 5.7680e6, 7.6025e6),
    "6-node user element": (36386.0, 1.9317e6, 3.8104e6, 3.9763e6, 5.7636e6, 7.5964e6),
    "CAX8": (36386.0, 1.9320e6, 3.8113e6, 3.9784e6, 5.7679e6, 7.6010e6),
    "8-node user element": (36390.0, 1.9310e6, 3.8080e6, 3.9723e6, 5.7537e6, 7.5789e6),
}


@dataclass(frozen=True)
class Item:
    """A figure, table or numbered equation.

    Attributes:
        kind: Kind of item.
        number: Number in the paper.
        content: Subject of the item.
        section: Section of the paper.
        module: File that computes it; for an equation, the file that cites "Eq. (number)".
        figure: File that draws it; empty for equations.
    """

    kind: Literal["figure", "table", "equation"]
    number: str
    content: str
    section: str
    module: str
    figure: str = ""

    @property
    def source_path(self) -> str:
        """File that draws the item or, if there is none, computes it."""
        return self.figure or self.module


_MECHANICS = "pw_elements/elasticity/body.py"
_ELEMENTS = "pw_elements/spaces/elements.py"
_SPACES = "pw_elements/spaces/spaces.py"
_EIGEN = "pw_elements/algebra/eigen.py"
_WEIGHTS = "study/paper/s3_weight_functions.py"
_MODULE_BY_SECTION = {
    "3": _WEIGHTS,
    "5": "study/paper/s5_condensation.py",
    "7.1": "study/paper/s7_1_two_triangles.py",
    "7.2": "study/paper/s7_2_block.py",
    "7.3": "study/paper/s7_3_parabolic_punch.py",
    "7.4": "study/paper/s7_4_rigid_plate.py",
    "7.5": "study/paper/s7_5_column.py",
    "7.6": "study/paper/s7_6_buckling.py",
}


_JOINT_FIGURES = ((7, 8), (13, 14), (16, 23), (24, 25))  # first and last figure of each drawing


def _make_figure_item(section: str, number: int, content: str) -> Item:
    names = [f"fig{a:02}_{b:02}" for a, b in _JOINT_FIGURES if a <= number <= b] or [
        f"fig{number:02}"
    ]
    drawn = f"figures/{names[0]}.py"
    return Item("figure", str(number), content, section, _MODULE_BY_SECTION[section], drawn)


def _make_table_item(section: str, number: int, content: str) -> Item:
    drawn = f"figures/tab{number:02}.py"
    return Item("table", str(number), content, section, _MODULE_BY_SECTION[section], drawn)


def _make_equation_item(section: str, number: int, content: str, module: str) -> Item:
    return Item("equation", str(number), content, section, module)


ITEMS = [
    _make_figure_item("3", 1, "6-node triangle in the parent domain"),
    _make_figure_item("3", 2, "weight functions of nodes 1 and 4"),
    _make_figure_item("5", 3, "two triangles make an 8-node quadrilateral"),
    _make_figure_item("7.1", 4, "the structure of two triangles"),
    _make_figure_item("7.1", 5, "its reactions by both methods"),
    _make_figure_item("7.2", 6, "elastic block on a rigid foundation"),
    _make_figure_item("7.2", 7, "contact stresses, 6-node triangles"),
    _make_figure_item("7.2", 8, "contact stresses, 8-node quadrilaterals"),
    _make_figure_item("7.3", 9, "parabolic rigid punch"),
    _make_figure_item("7.3", 10, "its contact stresses"),
    _make_figure_item("7.4", 11, "rigid plate: profile and mesh"),
    _make_figure_item("7.4", 12, "its contact stresses"),
    _make_figure_item("7.4", 13, "its reaction forces, CPS8"),
    _make_figure_item("7.4", 14, "its reaction forces, user element"),
    _make_figure_item("7.5", 15, "stepped column: section and mesh"),
    *(
        _make_figure_item("7.5", 16 + 2 * i + j, f"{stress} on contact surface {i + 1}")
        for i in range(4)
        for j, stress in enumerate(("normal pressure", "shear stress"))
    ),
    _make_figure_item("7.6", 24, "half beam, symmetric buckling: mesh and supports"),
    _make_figure_item("7.6", 25, "half beam, antisymmetric buckling: mesh and supports"),
    _make_table_item("7.5", 1, "the first six eigenvalues of the stepped column"),
    _make_table_item("7.6", 2, "critical stresses of the beam"),
    _make_equation_item("2", 1, "equations of motion", _MECHANICS),
    _make_equation_item("2", 2, "weak form", _MECHANICS),
    _make_equation_item("2", 3, "trial functions", _SPACES),
    _make_equation_item("2", 4, "accelerations", _MECHANICS),
    _make_equation_item("2", 5, "strains", _MECHANICS),
    _make_equation_item("2", 6, "stresses", _MECHANICS),
    _make_equation_item("2", 7, "test functions", _SPACES),
    _make_equation_item("2", 8, "gradients of the weight functions", _MECHANICS),
    _make_equation_item("2", 9, "discrete equations of motion", _MECHANICS),
    _make_equation_item("2", 10, "stiffness matrix", _MECHANICS),
    _make_equation_item("2", 11, "mass matrix", _MECHANICS),
    _make_equation_item("2", 12, "force vector", _MECHANICS),
    _make_equation_item("2", 13, "harmonic motion", _EIGEN),
    _make_equation_item("2", 14, "eigenvalue problem of vibration", _EIGEN),
    *(
        _make_equation_item("3", 14 + node, f"weight function of node {node}", _WEIGHTS)
        for node in range(1, 7)
    ),
    _make_equation_item("4", 21, "element stiffness matrix", _WEIGHTS),
    _make_equation_item("4", 22, "constitutive matrix of plane stress", _MECHANICS),
    _make_equation_item("4", 23, "sum over the four sub-elements", _WEIGHTS),
    _make_equation_item("6", 24, "buckling problem", _EIGEN),
    _make_equation_item("6", 25, "initial stress matrix", _MECHANICS),
    _make_equation_item("6", 26, "gradients in it", _MECHANICS),
    _make_equation_item("7.6", 27, "Euler's critical stress", "study/paper/s7_6_exact.py"),
]

# Titles of those sections of the paper that have no page; pages state their own titles
TITLES_WITHOUT_PAGE = {
    "2": "Weak formulation",
    "4": "Stiffness matrix",
    "6": "Initial stress matrix",
}
PAPER_SECTIONS = [section for section, module in SECTIONS.items() if ".paper." in module]
_ROOT = Path(__file__).parents[2]


def format_section_table() -> str:
    """Return a Markdown table of the paper's sections, their items and their source files."""
    sections = sorted({*TITLES_WITHOUT_PAGE, *PAPER_SECTIONS}, key=section_sort_key)
    head = ["section", "of the paper", "page and code", "scripts of figures"]
    rows = [f"| {' | '.join(head)} |", "|---" * len(head) + "|"]
    return "\n".join([*rows, *map(_format_section_row, sections)])


def _format_section_row(section: str) -> str:
    items = [item for item in ITEMS if item.section == section]
    name = TITLES_WITHOUT_PAGE.get(section) or title(section)
    computed = {item.module for item in items}
    if section in PAPER_SECTIONS:
        computed.add(find_page_source(section).relative_to(_ROOT).as_posix())
    drawn = [
        path
        for path in sorted(_ROOT.glob("figures/*.py"))
        if read_literal_constants(path).get("SECTION") == section
    ]
    cells = [
        f"{section}: {name}",
        "; ".join(
            filter(None, (_format_item_numbers(items, kind) for kind in _PLURAL_ABBREVIATIONS))
        ),
        ", ".join(f"`{path}`" for path in sorted(computed)),
        ", ".join(f"`{path.relative_to(_ROOT).as_posix()}`" for path in drawn),
    ]
    return f"| {' | '.join(cells)} |".replace("|  |", "| |").replace("|  |", "| |")


_PLURAL_ABBREVIATIONS = {"figure": "Figs", "table": "Tables", "equation": "Eqs"}
_SINGULAR_ABBREVIATIONS = {"figure": "Fig.", "table": "Table", "equation": "Eq."}


def _format_item_numbers(items: list[Item], kind: str) -> str:
    """Return the numbers of the items of a kind, such as "Figs 6-8"; empty if there are none."""
    numbers = sorted(int(item.number) for item in items if item.kind == kind)
    shown = [f"({n})" if kind == "equation" else f"{n}" for n in numbers]
    if len(shown) < 2:
        return f"{_SINGULAR_ABBREVIATIONS[kind]} {shown[0]}" if shown else ""
    joint = "-" if numbers[-1] - numbers[0] == len(numbers) - 1 else ", "
    ends = (shown[0], shown[-1]) if joint == "-" else shown
    return f"{_PLURAL_ABBREVIATIONS[kind]} {joint.join(ends)}"


if __name__ == "__main__":
    print(format_section_table())
