"""Hostile decks are either refused or read correctly, in little time and memory."""

import pytest

from tests.library.hostile_decks import HOSTILE_DECK_FILES_AND_REFUSAL_BY_NAME
from tests.library.limited_reading import (
    MAX_MEGABYTES_OF_MEMORY_PER_FILE,
    read_files_under_cpu_and_memory_limits,
)

N_TEST_BATCHES = 4
# Decks below this size (bytes) are compared with the independent reading, which is slow
MAX_DECK_BYTES_TO_COMPARE = 100_000


def check_small_deck_by_independent_reading(tagged_mesh, deck_path):
    """Return "" if an independent reading finds the same mesh; raise AssertionError otherwise.

    Large decks are not compared.
    """
    from tests.library.test_decks import assert_equal_to_independent_reading

    files = [file for file in deck_path.parent.rglob("*") if file.is_file()]
    if sum(file.stat().st_size for file in files) < MAX_DECK_BYTES_TO_COMPARE:
        assert_equal_to_independent_reading(tagged_mesh, deck_path)
    return ""


def write_deck_files(folder, files):
    """Write the files of a deck, with text in UTF-8, and return the path of the main file."""
    for name, content in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return folder / "deck.inp"


@pytest.mark.parametrize("index", range(N_TEST_BATCHES))
def test_hostile_decks_are_refused_or_read_as_they_are(tmp_path, index):
    names = [*HOSTILE_DECK_FILES_AND_REFUSAL_BY_NAME][index::N_TEST_BATCHES]
    assert len(names) > 37
    paths = {
        write_deck_files(tmp_path / str(k), HOSTILE_DECK_FILES_AND_REFUSAL_BY_NAME[name][0]): name
        for k, name in enumerate(names)
    }
    results = read_files_under_cpu_and_memory_limits(
        paths, "tests.library.test_hostile_decks:check_small_deck_by_independent_reading"
    )
    for path, name in paths.items():
        result, is_refused = results[path], HOSTILE_DECK_FILES_AND_REFUSAL_BY_NAME[name][1]
        allowed = {True: ("refused",), False: ("read",), None: ("refused", "read")}[is_refused]
        assert result["outcome"] in allowed, (name, result)
        assert result["differences"] == "", (name, result)
        assert result["megabytes"] <= MAX_MEGABYTES_OF_MEMORY_PER_FILE, (name, result)
        if result["outcome"] == "refused":
            assert str(path.parent) in result["message"], (name, result)
