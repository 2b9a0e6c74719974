"""Assign each sentence of the paper to the statements that quote it, or state why it has none.

`python3 -m study.judge.sentences PATH` compares `sentences.toml` with the text of the paper and
prints all disagreements. The text is not part of this project, which stores only the first words
and a digest of each sentence.
"""

import argparse
import hashlib
import re
import sys
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from study.judge.claims import Claim, load_paper_claims

SENTENCES_FILE = Path(__file__).parent / "sentences.toml"
REFERENCES_HEADING = "## REFERENCES"  # followed by the references and parts of another paper
N_FIRST_WORDS = 5  # number of words that identify a sentence

# Headings, captions, equations and tables are not divided into sentences
_UNDIVIDED_BLOCK = re.compile(r"#|\*\*|\$\$|Figs?\.|Table \d\.|Mode")
_SENTENCE_BOUNDARY = re.compile(r"(?<=\.)\s+(?=[A-Z$])")


@dataclass(frozen=True)
class Sentence:
    """Entry for a sentence, heading, caption, equation or row of a table of the paper.

    Attributes:
        number: Position in the paper, starting from 1.
        begins: First words.
        digest: Digest of the entire sentence.
        claims: Ids of the statements whose quotations include all or part of the sentence.
        repeats: Ids of statements that the sentence repeats in words other than those quoted.
        reason: Reason why the sentence contains no statement, if no ids are listed.
    """

    number: int
    begins: str
    digest: str
    claims: Sequence[str] = ()
    repeats: Sequence[str] = ()
    reason: str = ""


def load_sentences(path: Path = SENTENCES_FILE) -> list[Sentence]:
    """Read the entries of all sentences from a TOML file."""
    tables = tomllib.loads(path.read_text(encoding="utf-8"))["sentence"]
    return [Sentence(**table) for table in tables]


def split_sentences(text: str) -> list[str]:
    """Split the Markdown text of the paper into sentences, up to the list of references."""
    text_before_references, _, _ = text.partition(REFERENCES_HEADING)
    sentences = []
    for block in map(str.strip, re.split(r"\n\s*\n", text_before_references)):
        block_sentences = (
            [block] if _UNDIVIDED_BLOCK.match(block) else _SENTENCE_BOUNDARY.split(block)
        )
        sentences += [" ".join(sentence.split()) for sentence in block_sentences if sentence]
    return sentences


def identifying_first_words(sentence: str) -> str:
    """Return the first words of a sentence, by which entries identify it."""
    return " ".join(sentence.split()[:N_FIRST_WORDS])


def digest_sentence(sentence: str) -> str:
    """Return the first 16 hexadecimal digits of the SHA-256 digest of a sentence."""
    return hashlib.sha256(sentence.encode()).hexdigest()[:16]


def compare_entries_with_paper_text(
    sentences: list[Sentence], paper_sentences: list[str], claims: list[Claim]
) -> list[str]:
    """Return messages on disagreements between the entries, the paper's text and the statements."""
    messages = []
    if len(sentences) != len(paper_sentences):
        messages.append(
            f"{len(sentences)} sentences are known, the text has {len(paper_sentences)}"
        )
    for sentence, paper_sentence in zip(sentences, paper_sentences, strict=False):
        words, digest = identifying_first_words(paper_sentence), digest_sentence(paper_sentence)
        if (sentence.begins, sentence.digest) != (words, digest):
            messages.append(f"sentence {sentence.number} begins {words!r}, not {sentence.begins!r}")
    for claim in claims:
        numbers = [sentence.number for sentence in sentences if claim.id in sentence.claims]
        quoted_text = " ".join(
            _remove_formula_markup(paper_sentences[number - 1])
            for number in numbers
            if number <= len(paper_sentences)
        )
        if _remove_formula_markup(claim.quote or "") not in quoted_text:
            messages.append(f"{claim.id} quotes what is not in its sentences {numbers}")
    return messages


def _remove_formula_markup(sentence: str) -> str:
    """Return a sentence without the LaTeX markup of formulas, which quotations omit."""
    return " ".join(sentence.replace("$", "").replace(r"\sigma_{cr}", "σ_cr").split())


def find_faulty_entries(sentences: list[Sentence], claims: list[Claim]) -> list[str]:
    """Return messages on faults of the entries that can be detected without the paper's text."""
    claim_ids = {claim.id for claim in claims}
    cited_ids = {claim_id for sentence in sentences for claim_id in sentence.claims}
    messages = [f"{name} stands in no sentence" for name in sorted(claim_ids - cited_ids)]
    for position, sentence in enumerate(sentences, start=1):
        unknown_ids = {*sentence.claims, *sentence.repeats} - claim_ids
        messages += [
            f"sentence {sentence.number} names {name}, no statement" for name in sorted(unknown_ids)
        ]
        if sentence.number != position:
            messages.append(f"sentence {sentence.number} stands at place {position}")
        if bool(sentence.claims or sentence.repeats) == bool(sentence.reason):
            messages.append(f"sentence {sentence.number} needs either statements or a reason")
    return messages


def main(arguments: list[str] | None = None) -> int:
    """Compare the entries with the paper's text; return the exit status."""
    parser = argparse.ArgumentParser(prog="study.judge.sentences", description=__doc__)
    parser.add_argument("text", type=Path, metavar="PATH")
    paper_sentences = split_sentences(parser.parse_args(arguments).text.read_text(encoding="utf-8"))
    sentences, claims = load_sentences(), load_paper_claims()
    messages = find_faulty_entries(sentences, claims) + compare_entries_with_paper_text(
        sentences, paper_sentences, claims
    )
    print("\n".join(messages) or f"{len(sentences)} sentences agree")
    return int(bool(messages))


if __name__ == "__main__":
    sys.exit(main())
