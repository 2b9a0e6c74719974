"""The glossary: its number of terms, its columns, and its references to the code."""

import importlib
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
MAX_GLOSSARY_TERMS = 60
GLOSSARY_ROWS = [
    [cell.strip() for cell in line[1:-1].split("|")]
    for line in (ROOT / "docs/glossary.md").read_text().splitlines()
    if line.startswith("| ") and not line.startswith(("| Term", "| ---"))
]


def find_object(dotted_name):
    """Return the module, class or attribute with a given dotted name.

    If the name is that of a field of a class, return the name of the field.
    """
    parts = dotted_name.split(".")
    for length in range(len(parts), 0, -1):
        try:
            item = importlib.import_module(".".join(parts[:length]))
        except ModuleNotFoundError:
            continue
        for name in parts[length:]:
            if name in getattr(item, "__annotations__", {}):
                return name
            item = getattr(item, name)
        return item
    raise ModuleNotFoundError(dotted_name)


def test_each_term_has_a_symbol_a_sentence_and_a_place_in_the_code():
    assert 40 < len(GLOSSARY_ROWS) <= MAX_GLOSSARY_TERMS
    assert {len(row) for row in GLOSSARY_ROWS} == {4}
    terms = [row[0] for row in GLOSSARY_ROWS]
    assert len(set(terms)) == len(terms)
    assert [row[0] for row in GLOSSARY_ROWS if not row[2].endswith(".") or row[2].count(". ")] == []


@pytest.mark.parametrize("row", GLOSSARY_ROWS, ids=[row[0] for row in GLOSSARY_ROWS])
def test_the_code_holds_each_term(row):
    (dotted_name,) = re.findall(r"`(pw_elements[\w.]*)`", row[3])
    assert find_object(dotted_name) is not None
