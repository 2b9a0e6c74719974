"""Test that each sentence of the paper is listed with statements or a reason for having none."""

import os
from dataclasses import replace
from pathlib import Path

import pytest

from study.judge.claims import load_paper_claims
from study.judge.sentences import (
    compare_entries_with_paper_text,
    digest_sentence,
    find_faulty_entries,
    identifying_first_words,
    load_sentences,
    main,
    split_sentences,
)

LISTED_SENTENCES = load_sentences()
PAPER_CLAIMS = load_paper_claims()
PAPER_TEXT_FILE = Path(os.environ.get("PW_ELEMENTS_PAPER", ""))  # a file with the paper's text


def test_every_sentence_has_statements_or_a_reason_and_every_statement_a_sentence():
    assert find_faulty_entries(LISTED_SENTENCES, PAPER_CLAIMS) == []


@pytest.mark.skipif(
    not PAPER_TEXT_FILE.is_file(), reason="the paper's text is not part of this project"
)
def test_listed_sentences_are_those_of_the_paper(capsys):
    assert main([str(PAPER_TEXT_FILE)]) == 0, capsys.readouterr().out


def test_listed_sentences_quote_at_most_five_words():
    assert max(len(listed_sentence.begins.split()) for listed_sentence in LISTED_SENTENCES) <= 5


def test_split_ends_sentences_before_capitals_and_keeps_headings_and_captions():
    text = "# A. Head\n\nOne, e.g. [3], in Fig. 1. Two\nlines. $x$ is one.\n\nFig. 2. A b. C d.\n"
    expected = [
        "# A. Head",
        "One, e.g. [3], in Fig. 1.",
        "Two lines.",
        "$x$ is one.",
        "Fig. 2. A b. C d.",
    ]
    assert split_sentences(text + "\n## REFERENCES\n\n- [1] A. B.") == expected


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"reason": "", "claims": ()}, "needs either statements or a reason"),
        ({"reason": "Heading.", "claims": ("71-four",)}, "needs either statements or a reason"),
        ({"reason": "", "repeats": ("no-such",)}, "names no-such, no statement"),
        ({"number": 7}, "sentence 7 stands at place 1"),
    ],
)
def test_incomplete_entries_are_reported(changes, message):
    messages = find_faulty_entries(
        [replace(LISTED_SENTENCES[0], **changes), *LISTED_SENTENCES[1:]], PAPER_CLAIMS
    )
    assert [reported_line for reported_line in messages if message in reported_line]


def test_changed_text_and_wrong_quote_are_reported():
    (claim,) = [paper_claim for paper_claim in PAPER_CLAIMS if paper_claim.id == "71-four"]
    sentence = f"He said that {claim.quote}, or so."
    listed_sentence = replace(
        LISTED_SENTENCES[0],
        begins=identifying_first_words(sentence),
        digest=digest_sentence(sentence),
        claims=(claim.id,),
    )
    assert compare_entries_with_paper_text([listed_sentence], [sentence], [claim]) == []
    (changed_text_message,) = compare_entries_with_paper_text(
        [listed_sentence], [sentence + " Not."], [claim]
    )
    assert "sentence 1 begins" in changed_text_message
    (wrong_quote_message,) = compare_entries_with_paper_text(
        [listed_sentence], [sentence], [replace(claim, quote="five times")]
    )
    assert "71-four quotes what is not in its sentences" in wrong_quote_message
    assert (
        "1 sentences are known"
        in compare_entries_with_paper_text([listed_sentence], [sentence, sentence], [claim])[0]
    )
