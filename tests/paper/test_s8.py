"""Section 8: what the paper concludes; and that no statement of it goes without a test."""

from pathlib import Path

from tests.paper.statements import STATEMENTS, judged, section

test_statement = judged("8")


def test_every_statement_belongs_to_a_section_with_a_test():
    files = {path.stem.removeprefix("test_s") for path in Path(__file__).parent.glob("test_s*.py")}
    assert {section(claim).replace(".", "_") for claim in STATEMENTS.values()} == files
