"""Write the gallery: run each example and show its picture, output and code."""

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

EXAMPLES_FOLDER = Path(__file__).resolve().parents[3] / "examples"
GALLERY_ORDER = (
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
        name: Name of its file, without extension.
        title: First paragraph of its docstring.
        description: Remainder of its docstring.
        library_names: Public names of the library that the example imports.
        companion_files: Names of further files that the example requires.
    """

    name: str
    title: str
    description: str
    library_names: frozenset[str]
    companion_files: tuple[str, ...]

    @classmethod
    def from_source(cls, path: Path) -> "Example":
        """Read the example from its source file."""
        tree = ast.parse(path.read_text(encoding="utf-8"))
        title, _, description = (ast.get_docstring(tree) or "").partition("\n\n")
        library_names = {
            f"{node.module}.{alias.name}"
            for node in ast.walk(tree)
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("pw_elements")
            for alias in node.names
        }
        stem = path.stem
        companion_paths = sorted(EXAMPLES_FOLDER.glob(f"{stem}.msh")) + sorted(
            EXAMPLES_FOLDER.glob(f"{stem}_mesh.py")
        )
        companion_files = tuple(companion.name for companion in companion_paths)
        return cls(
            stem, " ".join(title.split()), description, frozenset(library_names), companion_files
        )


def load_examples() -> list[Example]:
    """Return all examples in the order of the gallery."""
    stems = {path.stem for path in EXAMPLES_FOLDER.glob("*.py") if not path.stem.endswith("_mesh")}
    ordered_names = [name for name in GALLERY_ORDER if name in stems] + sorted(
        stems - {*GALLERY_ORDER}
    )
    return [Example.from_source(EXAMPLES_FOLDER / f"{name}.py") for name in ordered_names]


def write_gallery(
    cache_folder: Path, pages_folder: Path, jobs: int = 1
) -> dict[str, list[Example]]:
    """Write the pages of the gallery.

    Args:
        cache_folder: Folder of pictures; examples are run if their pictures are missing or
            outdated.
        pages_folder: Folder of the pages.
        jobs: Number of examples that run simultaneously.

    Returns:
        Examples that use each public name of the library, by name.
    """
    examples = load_examples()
    with ThreadPoolExecutor(max(1, jobs)) as pool:
        list(pool.map(lambda example: _run_if_outdated(example, cache_folder), examples))
    pages_folder.mkdir(parents=True)
    for example in examples:
        shutil.copy(cache_folder / f"{example.name}.png", pages_folder)
        _save_thumbnail(
            cache_folder / f"{example.name}.png", pages_folder / f"{example.name}.thumb.png"
        )
        shutil.copy(EXAMPLES_FOLDER / f"{example.name}.py", pages_folder)
        for file in example.companion_files:
            shutil.copy(EXAMPLES_FOLDER / file, pages_folder)
        (pages_folder / f"{example.name}.md").write_text(
            _format_page(example, cache_folder), encoding="utf-8"
        )
    (pages_folder / "index.md").write_text(_format_index(examples), encoding="utf-8")
    examples_by_name: dict[str, list[Example]] = {}
    for example in examples:
        for name in sorted(example.library_names):
            examples_by_name.setdefault(name, []).append(example)
    return examples_by_name


def example_heading(example: Example) -> str:
    """Return the title of an example, formatted as a heading."""
    return example.name.replace("_", " ").capitalize()


def _format_page(example: Example, cache_folder: Path) -> str:
    output = (cache_folder / f"{example.name}.txt").read_text(encoding="utf-8").strip()
    files = "".join(f", {{download}}`{file} <{file}>`" for file in example.companion_files)
    parts = [
        f"# {example_heading(example)}",
        example.title,
        f"```{{image}} {example.name}.png\n:alt: {example.title}\n```",
        example.description,
        f"```sh\n~/pw-elements/run python3 ~/pw-elements/examples/{example.name}.py\n```",
        *([f"Output:\n\n```text\n{output}\n```"] if output else []),
        f"{{download}}`{example.name}.py <{example.name}.py>`{files}",
        f"```{{literalinclude}} {example.name}.py\n:language: python\n```",
    ]
    return "\n\n".join(parts) + "\n"


def _format_index(examples: list[Example]) -> str:
    cards = [
        f":::{{grid-item-card}} {example_heading(example)}\n:link: {example.name}\n:link-type: "
        "doc\n"
        f":img-top: {example.name}.thumb.png\n:img-alt: {example.title}\n\n{example.title}\n:::"
        for example in examples
    ]
    toctree = "\n".join(example.name for example in examples)
    text = (
        "Each example is a short script, run as it stands when this site is built. Copy one and "
        "adapt it; it saves its picture in the current folder."
    )
    grid = "\n".join(["::::{grid} 1 1 2 2", ":gutter: 3", "", *cards, "::::"])
    return f"# Gallery\n\n{text}\n\n{grid}\n\n```{{toctree}}\n:hidden:\n\n{toctree}\n```\n"


def _save_thumbnail(picture_path: Path, thumbnail_path: Path) -> None:
    """Save a small version of a picture for the index of the gallery, which shows all pictures."""
    with Image.open(picture_path) as image:
        image.thumbnail((560, 560))
        image.convert("RGB").quantize(96).save(thumbnail_path, optimize=True)


def _run_if_outdated(example: Example, cache_folder: Path) -> None:
    """Run an example unless its picture was made with the current example and library.

    Raises:
        StudyError: If the example fails.
    """
    digest = hashlib.sha256()
    for file in (f"{example.name}.py", *example.companion_files):
        digest.update((EXAMPLES_FOLDER / file).read_bytes())
    for path in list_package_sources("pw_elements"):
        digest.update(f"{path.name} {digest_code(path)}".encode())
    digest_path, picture_path, output_path = (
        cache_folder / f"{example.name}.{suffix}" for suffix in ("sha256", "png", "txt")
    )
    files_exist = all(path.is_file() for path in (picture_path, output_path, digest_path))
    if files_exist and digest_path.read_bytes() == digest.hexdigest().encode():
        return
    environment = os.environ | {"PYTHONPATH": str(EXAMPLES_FOLDER.parent)}
    with tempfile.TemporaryDirectory() as folder:
        process = subprocess.run(
            [sys.executable, str(EXAMPLES_FOLDER / f"{example.name}.py")],
            cwd=folder,
            env=environment,
            capture_output=True,
            text=True,
            check=False,
        )
        if process.returncode:
            raise StudyError(f"examples/{example.name}.py failed: {process.stderr.strip()[-2000:]}")
        write_atomically(picture_path, (Path(folder) / f"{example.name}.png").read_bytes())
    write_atomically(output_path, process.stdout.encode())
    write_atomically(digest_path, digest.hexdigest().encode())
