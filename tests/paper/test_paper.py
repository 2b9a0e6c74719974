import random
import re
from pathlib import Path

from pw_elements.contact import OPEN, SLIP, STICK
from study import discretisation, vocabulary
from study.paper.items import ITEMS, map_table

PROJECT = Path(__file__).parents[2]
MAP = PROJECT / "docs" / "study.md"
PRINTED = {"figure": range(1, 26), "table": range(1, 3), "equation": range(1, 28)}


def test_every_figure_table_and_equation_is_listed_once():
    for kind, numbers in PRINTED.items():
        assert [item.number for item in ITEMS if item.kind == kind] == [str(n) for n in numbers]


def test_each_item_names_its_section_and_files_that_exist():
    for item in ITEMS:
        assert re.fullmatch(r"[2-7](\.[1-6])?", item.section), item
        assert (PROJECT / item.module).is_file(), item
        assert bool(item.figure) == (item.kind != "equation"), item
        assert (PROJECT / item.treated).is_file(), item


def test_equations_are_found_by_their_numbers_where_they_are_treated():
    for item in ITEMS:
        if item.kind == "equation":
            assert f"Eq. ({item.number})" in (PROJECT / item.module).read_text(), item
    for path in [*PROJECT.glob("pw_elements/**/*.py"), *PROJECT.glob("study/**/*.py")]:
        assert not re.search(r"\bEqs? \(", path.read_text()), f"{path}: not found by its number"


def test_figures_belong_to_the_sections_of_their_items():
    for item in ITEMS:
        if item.figure:
            assert f'SECTION = "{item.section}"' in (PROJECT / item.figure).read_text(), item


def test_the_map_is_the_table_of_what_is_where():
    assert map_table() in MAP.read_text(), "python3 -m study.paper.items"


def test_files_of_the_map_exist():
    named = re.findall(r"`([\w/]+\.py)`", map_table())
    assert len(named) > 100
    for name in named:
        assert (PROJECT / name).is_file(), name


def test_ids_stand_in_names_of_modules_and_figures():
    from study.core.cases import SECTIONS

    for section, module in SECTIONS.items():
        name = section.replace(".", "_").lower()
        prefix = f"s{name}_" if section[0].isdigit() else f"{name}_"
        assert module.rpartition(".")[2].startswith(prefix), module
        for path in PROJECT.glob("figures/*.py"):
            own = f'SECTION = "{section}"' in path.read_text()
            if own and not re.fullmatch(r"(fig|tab)\d\d(_\d\d)?", path.stem):
                assert path.stem.startswith(prefix), path


def test_random_items_are_found_in_one_opened_file():
    """A figure's, table's or equation's number leads by one search to the file that treats it."""
    for item in random.Random(9).sample(ITEMS, 15):
        mark = f"Eq. ({item.number})" if item.kind == "equation" else item.figure
        where = PROJECT / item.module if item.kind == "equation" else MAP
        assert mark in where.read_text()


def test_the_vocabulary_is_the_librarys_and_the_studys():
    assert (vocabulary.OPEN, vocabulary.STICK, vocabulary.SLIP) == (OPEN, STICK, SLIP)
    assert set(vocabulary.ELEMENTS) == {*discretisation._SPACES, "exact"}
    assert set(vocabulary.PLANE_ELEMENTS) < set(vocabulary.ELEMENTS)
