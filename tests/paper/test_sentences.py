"""Every sentence of the paper is accounted for."""

import os
from dataclasses import replace
from pathlib import Path

import pytest

from study.judge.claims import load_paper_claims
from study.judge.sentences import begins, digest, disagreements, incomplete, load, main, split

KNOWN = load()
CLAIMS = load_paper_claims()
TEXT = Path(os.environ.get("PW_ELEMENTS_PAPER", ""))  # a file with the paper's text


def test_all_sentences_have_statements_or_a_reason_and_all_statements_a_sentence():
    assert incomplete(KNOWN, CLAIMS) == []


@pytest.mark.skipif(not TEXT.is_file(), reason="the paper's text is not part of this project")
def test_they_are_those_of_the_paper(capsys):
    assert main([str(TEXT)]) == 0, capsys.readouterr().out


def test_no_sentence_of_the_paper_is_in_the_tree():
    assert max(len(one.begins.split()) for one in KNOWN) <= 5


def test_sentences_end_at_points_before_capitals_and_blocks_are_whole():
    text = "# A. Head\n\nOne, e.g. [3], in Fig. 1. Two\nlines. $x$ is one.\n\nFig. 2. A b. C d.\n"
    expected = [
        "# A. Head",
        "One, e.g. [3], in Fig. 1.",
        "Two lines.",
        "$x$ is one.",
        "Fig. 2. A b. C d.",
    ]
    assert split(text + "\n## REFERENCES\n\n- [1] A. B.") == expected


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"reason": "", "claims": ()}, "needs either statements or a reason"),
        ({"reason": "Heading.", "claims": ("71-four",)}, "needs either statements or a reason"),
        ({"reason": "", "repeats": ("no-such",)}, "names no-such, no statement"),
        ({"number": 7}, "sentence 7 stands at place 1"),
    ],
)
def test_what_is_incomplete_is_said(changes, message):
    found = incomplete([replace(KNOWN[0], **changes), *KNOWN[1:]], CLAIMS)
    assert [line for line in found if message in line]


def test_another_text_and_a_wrong_quote_are_said():
    (claim,) = [c for c in CLAIMS if c.id == "71-four"]
    sentence = f"He said that {claim.quote}, or so."
    one = replace(KNOWN[0], begins=begins(sentence), digest=digest(sentence), claims=(claim.id,))
    assert disagreements([one], [sentence], [claim]) == []
    (changed,) = disagreements([one], [sentence + " Not."], [claim])
    assert "sentence 1 begins" in changed
    (misquoted,) = disagreements([one], [sentence], [replace(claim, quote="five times")])
    assert "71-four quotes what is not in its sentences" in misquoted
    assert "1 sentences are known" in disagreements([one], [sentence, sentence], [claim])[0]
