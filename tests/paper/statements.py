"""The paper's statements by its sections, and how each is judged."""

import re

import pytest

from study.judge.claims import PAPER, judge, load_claims

STATEMENTS = {claim.id: claim for claim in load_claims() if claim.kind in PAPER}
INTRODUCTION = "1"  # and the abstract


def section(claim):
    """The section that a statement is of: the first one that its source names."""
    return re.search(r"(?<=[Ss]ection )\d(\.\d)?|$", claim.source.split(";")[0])[0] or INTRODUCTION


def judged(number):
    """A test of each statement of a section: it is judged as it is pinned, contradicted ones too.

    Where a statement fails, what is found instead is pinned with it.
    """
    claims = [claim for claim in STATEMENTS.values() if section(claim) == number]
    assert claims, number

    @pytest.mark.parametrize("claim", claims, ids=lambda claim: claim.id)
    def test_statement(claim, results):
        (found,) = judge([claim], results)
        assert not found.differs, f"{found.verdict} with {found.measured}, not {found.expected}"

    return test_statement


def printed(name):
    """The number that a statement is judged by."""
    return STATEMENTS[name].judgement.value
