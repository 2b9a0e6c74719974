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

from study.run.sources import digest_code_without_docstrings, list_package_sources
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
    "worn_pin",
    "tuning_fork",
    "bar_impact",
    "rubber_punch",
    "rubber_roller",
    "driven_wheel",
    "identify",
    "shaft_seal",
    "snap_fit",
    "seal",
    "relaxing_seal",
    "indentation_hardness",
    "buckling",
    "heated_joint",
    "seepage",
    "poisson",
)


@dataclass(frozen=True)
class GalleryExample:
    """Example script of the gallery.

    Attributes:
        name: Name of the script without extension.
        title: First paragraph of the script's docstring.
        description: Remainder of the docstring.
        library_names: Full names of the functions and classes of the library that the script
            imports.
        companion_files: Names of the mesh files and mesh scripts that the example reads.
    """

    name: str
    title: str
    description: str
    library_names: frozenset[str]
    companion_files: tuple[str, ...]

    @classmethod
    def from_source(cls, path: Path) -> "GalleryExample":
        """Create an example from the source file of its script, which is parsed but not run."""
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


def load_examples() -> list[GalleryExample]:
    """Return all examples in the order of the gallery."""
    stems = {path.stem for path in EXAMPLES_FOLDER.glob("*.py") if not path.stem.endswith("_mesh")}
    ordered_names = [name for name in GALLERY_ORDER if name in stems] + sorted(
        stems - {*GALLERY_ORDER}
    )
    return [GalleryExample.from_source(EXAMPLES_FOLDER / f"{name}.py") for name in ordered_names]


def run_examples_and_write_gallery(
    cache_folder: Path, pages_folder: Path, jobs: int = 1
) -> dict[str, list[GalleryExample]]:
    """Run outdated examples, and write a page for each example and an index.

    Args:
        cache_folder: Folder of pictures and outputs from earlier runs. An example is run again if
            it or the library has changed since.
        pages_folder: Folder of the pages, which must not exist.
        jobs: Number of examples that run simultaneously.

    Returns:
        Examples that import each function or class of the library, by its full name.

    Raises:
        StudyError: If an example fails.
    """
    examples = load_examples()
    with ThreadPoolExecutor(max(1, jobs)) as pool:
        list(pool.map(lambda example: _run_example_if_outdated(example, cache_folder), examples))
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
            _format_example_page(example, cache_folder), encoding="utf-8"
        )
    (pages_folder / "index.md").write_text(_format_gallery_index(examples), encoding="utf-8")
    examples_by_name: dict[str, list[GalleryExample]] = {}
    for example in examples:
        for name in sorted(example.library_names):
            examples_by_name.setdefault(name, []).append(example)
    return examples_by_name


def example_heading(example: GalleryExample) -> str:
    """Return the name of an example as a heading, such as "Plate with hole"."""
    return example.name.replace("_", " ").capitalize()


def _format_example_page(example: GalleryExample, cache_folder: Path) -> str:
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


def _format_gallery_index(examples: list[GalleryExample]) -> str:
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
    """Save a picture with at most 560 pixels and 96 colours for the index of the gallery."""
    with Image.open(picture_path) as image:
        image.thumbnail((560, 560))
        image.convert("RGB").quantize(96).save(thumbnail_path, optimize=True)


def _run_example_if_outdated(example: GalleryExample, cache_folder: Path) -> None:
    """Run an example and store its picture and output, if it or the library has changed.

    Comments and docstrings of the library are disregarded.

    Args:
        example: The example.
        cache_folder: Folder of the picture, the output and a digest of the sources.

    Raises:
        StudyError: If the example fails.
    """
    digest = hashlib.sha256()
    for file in (f"{example.name}.py", *example.companion_files):
        digest.update((EXAMPLES_FOLDER / file).read_bytes())
    for path in list_package_sources("pw_elements"):
        digest.update(f"{path.name} {digest_code_without_docstrings(path)}".encode())
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
