"""The gallery: each example run, with its picture, what it prints, and its code."""

import ast
import hashlib
import os
import shutil
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from PIL import Image

from study.run.sources import digest_code, list_package_sources
from study.run.store import StudyError, write_atomically

EXAMPLES = Path(__file__).resolve().parents[3] / "examples"
ORDER = (
    "plate_with_hole",
    "roller_on_dome",
    "gasket",
    "bracket",
    "sphere_on_block",
    "gears",
    "press_fit",
    "falling_friction",
    "tuning_fork",
    "bar_impact",
    "rubber_punch",
    "rubber_roller",
    "driven_wheel",
    "identify",
    "shaft_seal",
    "seal",
    "buckling",
    "seepage",
    "poisson",
)


@dataclass(frozen=True)
class Example:
    """An example of the gallery.

    Attributes:
        name: Of its file.
        title: First sentence of its docstring.
        text: The rest.
        uses: Public names of the library that it imports.
        files: Other files that it needs.
    """

    name: str
    title: str
    text: str
    uses: frozenset[str]
    files: tuple[str, ...]

    @classmethod
    def of(cls, path: Path) -> "Example":
        """Read it from its source."""
        tree = ast.parse(path.read_text(encoding="utf-8"))
        title, _, text = (ast.get_docstring(tree) or "").partition("\n\n")
        uses = {
            f"{node.module}.{alias.name}"
            for node in ast.walk(tree)
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("pw_elements")
            for alias in node.names
        }
        stem = path.stem
        beside = sorted(EXAMPLES.glob(f"{stem}.msh")) + sorted(EXAMPLES.glob(f"{stem}_mesh.py"))
        files = tuple(other.name for other in beside)
        return cls(stem, " ".join(title.split()), text, frozenset(uses), files)


def examples() -> list[Example]:
    """Return all examples, in the order of the gallery."""
    found = {path.stem for path in EXAMPLES.glob("*.py") if not path.stem.endswith("_mesh")}
    ordered = [name for name in ORDER if name in found] + sorted(found - {*ORDER})
    return [Example.of(EXAMPLES / f"{name}.py") for name in ordered]


def write(store: Path, pages: Path, jobs: int = 1) -> dict[str, list[Example]]:
    """Write the gallery's pages.

    Args:
        store: Folder of pictures; an example is run where its own is missing or outdated.
        pages: Folder of the pages.
        jobs: Number of examples that run at a time.

    Returns:
        The examples that use each public name.
    """
    every = examples()
    with ThreadPoolExecutor(max(1, jobs)) as pool:
        list(pool.map(lambda one: _ensure_run(one, store), every))
    pages.mkdir(parents=True)
    for one in every:
        shutil.copy(store / f"{one.name}.png", pages)
        _thumbnail(store / f"{one.name}.png", pages / f"{one.name}.thumb.png")
        shutil.copy(EXAMPLES / f"{one.name}.py", pages)
        for file in one.files:
            shutil.copy(EXAMPLES / file, pages)
        (pages / f"{one.name}.md").write_text(_page(one, store), encoding="utf-8")
    (pages / "index.md").write_text(_index(every), encoding="utf-8")
    used: dict[str, list[Example]] = {}
    for one in every:
        for name in sorted(one.uses):
            used.setdefault(name, []).append(one)
    return used


def short(one: Example) -> str:
    """Return an example's title as a heading has it."""
    return one.name.replace("_", " ").capitalize()


def _page(one: Example, store: Path) -> str:
    printed = (store / f"{one.name}.txt").read_text(encoding="utf-8").strip()
    files = "".join(f", {{download}}`{file} <{file}>`" for file in one.files)
    parts = [
        f"# {short(one)}",
        one.title,
        f"```{{image}} {one.name}.png\n:alt: {one.title}\n```",
        one.text,
        f"```sh\n~/pw-elements/run python3 ~/pw-elements/examples/{one.name}.py\n```",
        *([f"Output:\n\n```text\n{printed}\n```"] if printed else []),
        f"{{download}}`{one.name}.py <{one.name}.py>`{files}",
        f"```{{literalinclude}} {one.name}.py\n:language: python\n```",
    ]
    return "\n\n".join(parts) + "\n"


def _index(every: list[Example]) -> str:
    cards = [
        f":::{{grid-item-card}} {short(one)}\n:link: {one.name}\n:link-type: doc\n"
        f":img-top: {one.name}.thumb.png\n:img-alt: {one.title}\n\n{one.title}\n:::"
        for one in every
    ]
    tree = "\n".join(one.name for one in every)
    text = (
        "Each example is a short script, run as it stands when this site is built. Copy one and "
        "adapt it; it saves its picture in the current folder."
    )
    grid = "\n".join(["::::{grid} 1 1 2 2", ":gutter: 3", "", *cards, "::::"])
    return f"# Gallery\n\n{text}\n\n{grid}\n\n```{{toctree}}\n:hidden:\n\n{tree}\n```\n"


def _thumbnail(picture: Path, to: Path) -> None:
    """Make a picture small: the gallery's first page has all of them."""
    with Image.open(picture) as image:
        image.thumbnail((560, 560))
        image.convert("RGB").quantize(96).save(to, optimize=True)


def _ensure_run(one: Example, store: Path) -> None:
    """Run an example unless its picture is of this source and this library.

    Raises:
        StudyError: If it fails.
    """
    digest = hashlib.sha256()
    for file in (f"{one.name}.py", *one.files):
        digest.update((EXAMPLES / file).read_bytes())
    for path in list_package_sources("pw_elements"):
        digest.update(f"{path.name} {digest_code(path)}".encode())
    note, picture, printed = (store / f"{one.name}.{end}" for end in ("sha256", "png", "txt"))
    made = all(path.is_file() for path in (picture, printed, note))
    if made and note.read_bytes() == digest.hexdigest().encode():
        return
    environment = os.environ | {"PYTHONPATH": str(EXAMPLES.parent)}
    with tempfile.TemporaryDirectory() as folder:
        done = subprocess.run(
            [sys.executable, str(EXAMPLES / f"{one.name}.py")],
            cwd=folder,
            env=environment,
            capture_output=True,
            text=True,
            check=False,
        )
        if done.returncode:
            raise StudyError(f"examples/{one.name}.py failed: {done.stderr.strip()[-2000:]}")
        write_atomically(picture, (Path(folder) / f"{one.name}.png").read_bytes())
    write_atomically(printed, done.stdout.encode())
    write_atomically(note, digest.hexdigest().encode())
