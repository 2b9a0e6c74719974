"""Generate the website: guide, gallery and reference of the library, and evidence from the study.

All pages are static and generated. The evidence consists of one page (sheet) per section with
stored results, judged claims and figures. The reference is generated from docstrings, and the
gallery by running the examples. The pages load nothing from other servers.
"""

import io
import os
import shutil
from pathlib import Path

from study.publish.site import evidence, gallery, reference, search
from study.publish.texts import TEXTS_FOLDER, load_index_of_drawn_figures
from study.run.files import open_folder_replacement
from study.run.store import Results, StudyError

ROOT = Path(__file__).resolve().parents[3]
GUIDE_FOLDER = ROOT / "docs"
DRAFTS_FOLDER_NAME = "publication"
STATIC_FOLDER = Path(__file__).with_name("static")
FOLDER_KIND = "a site"

# The theme's script is a module that imports another module
_MODULE_TAG_REPLACEMENT = '<script type="module"', "<script defer"
_GUMSHOE_IMPORT = 'import * as Gumshoe from "./gumshoe-patched.js";'


def build_site(results: Results, out: Path, jobs: int = 1) -> list[str]:
    """Write the website into a folder, and replace an earlier version there.

    Args:
        results: Stored results; their folder also contains the claims and figures.
        out: Folder of the website.
        jobs: Number of examples of the gallery that run simultaneously.

    Returns:
        Messages on missing content, and warnings of Sphinx.

    Raises:
        ForeignFileOrFolder: If the folder contains anything other than an earlier version.
        StudyError: If claims or the index of figures are missing, or an example fails.
    """
    results.claims()  # report missing claims before running the gallery
    load_index_of_drawn_figures(results)
    out.parent.mkdir(parents=True, exist_ok=True)
    with open_folder_replacement(out, FOLDER_KIND) as replacement:
        source_folder = replacement.scratch / "source"
        problems = write_sources(results, source_folder, jobs)
        problems += _run_sphinx(source_folder, replacement.folder)
        problems += evidence.copy_report_and_result_files(results, replacement.folder)
    return problems


def write_sources(results: Results, source_folder: Path, jobs: int = 1) -> list[str]:
    """Write all source files of the website for Sphinx.

    Args:
        results: Stored results.
        source_folder: Folder of the source files, which must not exist.
        jobs: Number of examples of the gallery that run simultaneously.

    Returns:
        Messages on missing content of the evidence.
    """
    copy_guide_without_drafts(source_folder)
    shutil.copytree(STATIC_FOLDER, source_folder / "_static", dirs_exist_ok=True)
    shutil.copy(TEXTS_FOLDER / "formula.css", source_folder / "_static")
    shutil.copytree(search.TEMPLATES_FOLDER, source_folder / "_templates")
    for name in ("conf.py", "search_scorer.js"):
        shutil.copy(Path(__file__).with_name(name), source_folder)
    _write_source_licence_and_citation_page(source_folder)
    _write_page_of_changes(source_folder)
    _write_place_of_report(results, source_folder)
    examples_by_name = gallery.run_examples_and_write_gallery(
        results.folder / "gallery", source_folder / "gallery", jobs
    )
    reference.write_reference_pages(source_folder / "reference", examples_by_name)
    return evidence.write_evidence_pages(results, source_folder)


def copy_guide_without_drafts(source_folder: Path) -> None:
    """Copy the guide to the folder of sources, except drafts of journal articles."""
    shutil.copytree(GUIDE_FOLDER, source_folder, ignore=shutil.ignore_patterns(DRAFTS_FOLDER_NAME))


def _write_source_licence_and_citation_page(source_folder: Path) -> None:
    """Write the page on source code, licence and citation."""
    commit = os.environ.get("PW_ELEMENTS_COMMIT", "")
    commit_sentence = f" These pages are made of commit `{commit[:10]}`." if commit else ""
    parts = {
        "Source": "Links named [source], in the reference, show the code of all modules."
        + commit_sentence,
        "How to cite": f"```yaml\n{(ROOT / 'CITATION.cff').read_text('utf-8')}```",
        "Licence": (ROOT / "LICENSE").read_text("utf-8"),
    }
    text = "\n\n".join(f"## {heading}\n\n{body}" for heading, body in parts.items())
    (source_folder / "about.md").write_text(
        f"# Source, licence, citation\n\n{text}\n", encoding="utf-8"
    )


def _write_page_of_changes(source_folder: Path) -> None:
    """Write the page "What changed" from the file of changes.

    Links to files of the guide are adapted to the folder of sources, where the guide is.
    """
    text = (ROOT / "CHANGELOG.md").read_text("utf-8").replace("](docs/", "](")
    _, _, changes = text.partition("\n")
    (source_folder / "changes.md").write_text(f"# What changed\n{changes}", encoding="utf-8")


def _write_place_of_report(results: Results, source_folder: Path) -> None:
    """Write a page that the report replaces, and copy the report for the index of the search.

    The page gives the report a place in the navigation. It remains if there is no report.
    """
    (source_folder / "report.md").write_text(
        "# Report\n\nThere is no report: run `./run study`, then `./run site`.\n", encoding="utf-8"
    )
    if (report := results.folder / "report.html").is_file():
        shutil.copy(report, source_folder)


def _run_sphinx(source_folder: Path, pages_folder: Path) -> list[str]:
    """Run Sphinx to generate the pages; return its warnings."""
    try:
        from sphinx.application import Sphinx
        from sphinx.util.console import nocolor
        from sphinx.util.docutils import docutils_namespace, patch_docutils
    except ImportError as error:
        raise StudyError(f"the site needs Sphinx: start it by ./run site ({error})") from None
    nocolor()
    warning_stream = io.StringIO()
    with patch_docutils(), docutils_namespace():
        doctrees = source_folder / ".doctrees"
        app = Sphinx(
            str(source_folder),
            str(source_folder),
            str(pages_folder),
            str(doctrees),
            "html",
            status=None,
            warning=warning_stream,
        )
        app.build()
    shutil.rmtree(pages_folder / "_sources", ignore_errors=True)
    _inline_script_modules(pages_folder)
    lines = warning_stream.getvalue().replace(f"{source_folder}/", "").splitlines()
    return [line for line in lines if line.strip()]


def _inline_script_modules(pages_folder: Path) -> None:
    """Merge the JavaScript modules of the theme into one plain script, in place.

    Browsers refuse to load modules if a page is opened as a local file.
    """
    for page in pages_folder.rglob("*.html"):
        page.write_text(page.read_text("utf-8").replace(*_MODULE_TAG_REPLACEMENT), "utf-8")
    scripts = pages_folder / "_static" / "scripts"
    furo_script = (scripts / "furo.js").read_text("utf-8")
    if _GUMSHOE_IMPORT in furo_script:
        gumshoe_script = (scripts / "gumshoe-patched.js").read_text("utf-8")
        (scripts / "furo.js").write_text(
            gumshoe_script + furo_script.replace(_GUMSHOE_IMPORT, ""), "utf-8"
        )
