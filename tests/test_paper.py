from pathlib import Path

from study.paper.items import ITEMS

PROJECT = Path(__file__).parents[1]
PRINTED = {"figure": range(1, 26), "table": range(1, 3), "equation": range(1, 28)}


def test_every_figure_table_and_equation_is_listed_once():
    for kind, numbers in PRINTED.items():
        assert [item.number for item in ITEMS if item.kind == kind] == [str(n) for n in numbers]


def test_what_treats_an_item_exists():
    for item in ITEMS:
        assert (PROJECT / item.treated).is_file(), item
