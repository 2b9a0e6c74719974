import ast
import re
from pathlib import Path

from pw_elements.contact import OPEN, SLIP, STICK
from study.model import discretisation, vocabulary
from study.paper.items import ITEMS, TABLE_1, TABLE_2, format_section_table
from study.publish.texts import BLOCK_OF_CONSTANT
from study.run.cases import SECTIONS

PROJECT_FOLDER = Path(__file__).parents[2]
TEXT_CONSTANT_NAMES = {*BLOCK_OF_CONSTANT, "FACTS", "SHORT_FACTS"}
"""Names of the constants of a page whose texts appear in the report and on the site."""
STUDY_MAP_FILE = PROJECT_FOLDER / "docs" / "study.md"
ITEM_NUMBERS_BY_KIND = {"figure": range(1, 26), "table": range(1, 3), "equation": range(1, 28)}
PRINTED_TABLES = """
CAX6                  36389.  1.9319E+06  3.8114E+06  3.9787E+06  5.7680E+06  7.6025E+06
6-node user element   36386.  1.9317E+06  3.8104E+06  3.9763E+06  5.7636E+06  7.5964E+06
CAX8                  36386.  1.9320E+06  3.8113E+06  3.9784E+06  5.7679E+06  7.6010E+06
8-node user element   36390.  1.9310E+06  3.8080E+06  3.9723E+06  5.7537E+06  7.5789E+06

Euler                 2660E+06    10640E+06
CPS6                  2.6208E+09  9.8096E+09
CPS6M                 2.6105E+09  9.6683E+09
6-node user element   2.5608E+09  9.1833E+09
"""


def test_every_figure_table_and_equation_is_listed_once():
    for kind, numbers in ITEM_NUMBERS_BY_KIND.items():
        assert [item.number for item in ITEMS if item.kind == kind] == [str(n) for n in numbers]


def test_each_item_names_its_section_and_files_that_exist():
    for item in ITEMS:
        assert re.fullmatch(r"[2-7](\.[1-6])?", item.section), item
        assert (PROJECT_FOLDER / item.module).is_file(), item
        assert bool(item.figure) == (item.kind != "equation"), item
        assert (PROJECT_FOLDER / item.source_path).is_file(), item


def test_each_equation_number_stands_in_the_module_that_treats_it():
    for item in ITEMS:
        if item.kind == "equation":
            assert f"Eq. ({item.number})" in (PROJECT_FOLDER / item.module).read_text(), item
    for path in [
        *PROJECT_FOLDER.glob("pw_elements/**/*.py"),
        *PROJECT_FOLDER.glob("study/**/*.py"),
    ]:
        code = read_source_without_texts(path)
        assert not re.search(r"\bEqs? \(", code), f"{path}: not found by its number"


def read_source_without_texts(path):
    """Return the source of a module without the texts that it prints on a page.

    Texts, unlike code and comments, may cite several equations at once: "Eqs (25) and (26)".
    """
    source = path.read_text()
    lines = source.splitlines()
    for node in ast.parse(source).body:
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) in TEXT_CONSTANT_NAMES:
            lines[node.lineno - 1 : node.end_lineno] = [""] * (node.end_lineno - node.lineno + 1)
    return "\n".join(lines)


def test_figures_belong_to_the_sections_of_their_items():
    for item in ITEMS:
        if item.figure:
            assert f'SECTION = "{item.section}"' in (PROJECT_FOLDER / item.figure).read_text(), item


def test_study_map_is_the_section_table_and_its_files_exist():
    table = format_section_table()
    assert table in STUDY_MAP_FILE.read_text(), "python3 -m study.paper.items"
    named_files = re.findall(r"`([\w/]+\.py)`", table)
    assert len(named_files) > 40
    for name in named_files:
        assert (PROJECT_FOLDER / name).is_file(), name


def test_names_of_modules_and_figures_start_with_the_section_id():
    for section, module in SECTIONS.items():
        name = section.replace(".", "_").lower()
        prefix = f"s{name}_" if section[0].isdigit() else f"{name}_"
        page = module.removesuffix(".page").rpartition(".")[2]  # or the name of its folder
        assert page.startswith(prefix), module
        for path in PROJECT_FOLDER.glob("figures/*.py"):
            is_of_section = f'SECTION = "{section}"' in path.read_text()
            if is_of_section and not re.fullmatch(r"(fig|tab)\d\d(_\d\d)?", path.stem):
                assert path.stem.startswith(prefix), path


def test_vocabulary_agrees_with_library_and_study():
    assert (vocabulary.OPEN, vocabulary.STICK, vocabulary.SLIP) == (OPEN, STICK, SLIP)
    assert set(vocabulary.ELEMENTS) == {*discretisation._MAKE_SPACES, "exact"}
    assert set(vocabulary.PLANE_ELEMENTS) < set(vocabulary.ELEMENTS)


def test_constants_of_tables_1_and_2_agree_with_the_printed_text():
    for text, table in zip(PRINTED_TABLES.strip().split("\n\n"), (TABLE_1, TABLE_2), strict=True):
        rows = [(line[:22].rstrip(), line[22:].split()) for line in text.splitlines()]
        assert {name: tuple(map(float, numbers)) for name, numbers in rows} == table
