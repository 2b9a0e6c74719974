"""Every sentence of the paper, and the statements that quote it or why it claims nothing.

`python3 -m study.judge.sentences PATH` compares `sentences.toml` with the paper's text, which is
no part of this project, and prints what does not agree. Of a sentence the project has its first
words and a digest.
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

FILE = Path(__file__).parent / "sentences.toml"
END = "## REFERENCES"  # what follows are references, and pieces of another paper
WORDS = 5  # with which a sentence is recognised

# Headings, captions, equations and tables are one each
_WHOLE = re.compile(r"#|\*\*|\$\$|Figs?\.|Table \d\.|Mode")
_BETWEEN = re.compile(r"(?<=\.)\s+(?=[A-Z$])")


@dataclass(frozen=True)
class Sentence:
    """A sentence, heading, caption, equation or row of a table.

    Attributes:
        number: Its place.
        begins: Its first words.
        digest: Of the whole.
        claims: Statements whose quotes are in it, or run through it.
        repeats: Statements that it says again, in other words than they quote.
        reason: Why it claims nothing, if no statement is named.
    """

    number: int
    begins: str
    digest: str
    claims: Sequence[str] = ()
    repeats: Sequence[str] = ()
    reason: str = ""


def load(path: Path = FILE) -> list[Sentence]:
    """Read what is known of the sentences."""
    tables = tomllib.loads(path.read_text(encoding="utf-8"))["sentence"]
    return [Sentence(**table) for table in tables]


def split(text: str) -> list[str]:
    """Return the sentences of a text in Markdown, up to the references."""
    body, _, _ = text.partition(END)
    found = []
    for block in map(str.strip, re.split(r"\n\s*\n", body)):
        parts = [block] if _WHOLE.match(block) else _BETWEEN.split(block)
        found += [" ".join(part.split()) for part in parts if part]
    return found


def begins(sentence: str) -> str:
    """Return the words with which a sentence is recognised."""
    return " ".join(sentence.split()[:WORDS])


def digest(sentence: str) -> str:
    """Return a sentence's digest."""
    return hashlib.sha256(sentence.encode()).hexdigest()[:16]


def disagreements(known: list[Sentence], text: list[str], claims: list[Claim]) -> list[str]:
    """Return in words where sentences, the paper's text and the statements do not agree."""
    found = []
    if len(known) != len(text):
        found.append(f"{len(known)} sentences are known, the text has {len(text)}")
    for one, sentence in zip(known, text, strict=False):
        if (one.begins, one.digest) != (begins(sentence), digest(sentence)):
            found.append(f"sentence {one.number} begins {begins(sentence)!r}, not {one.begins!r}")
    for claim in claims:
        mine = [one.number for one in known if claim.id in one.claims]
        whole = " ".join(_plain(text[number - 1]) for number in mine if number <= len(text))
        if _plain(claim.quote or "") not in whole:
            found.append(f"{claim.id} quotes what is not in its sentences {mine}")
    return found


def _plain(sentence: str) -> str:
    """Return a sentence without the marks of formulas, as statements quote it."""
    return " ".join(sentence.replace("$", "").replace(r"\sigma_{cr}", "σ_cr").split())


def incomplete(known: list[Sentence], claims: list[Claim]) -> list[str]:
    """Return what can be seen to be wrong without the paper's text."""
    ids = {claim.id for claim in claims}
    named = {name for one in known for name in one.claims}
    found = [f"{name} stands in no sentence" for name in sorted(ids - named)]
    for place, one in enumerate(known, start=1):
        strange = {*one.claims, *one.repeats} - ids
        found += [f"sentence {one.number} names {name}, no statement" for name in sorted(strange)]
        if one.number != place:
            found.append(f"sentence {one.number} stands at place {place}")
        if bool(one.claims or one.repeats) == bool(one.reason):
            found.append(f"sentence {one.number} needs either statements or a reason")
    return found


def main(arguments: list[str] | None = None) -> int:
    """Compare; return the exit status."""
    parser = argparse.ArgumentParser(prog="study.judge.sentences", description=__doc__)
    parser.add_argument("text", type=Path, metavar="PATH")
    text = split(parser.parse_args(arguments).text.read_text(encoding="utf-8"))
    known, claims = load(), load_paper_claims()
    found = incomplete(known, claims) + disagreements(known, text, claims)
    print("\n".join(found) or f"{len(known)} sentences agree")
    return int(bool(found))


if __name__ == "__main__":
    sys.exit(main())
