"""The site: guide, gallery and reference of the library, and the study's evidence, as static pages.

Everything on it is made: sheets from stored results, judged claims and drawn figures, the reference
from docstrings, the gallery by running the examples. Nothing is fetched when it is read.
"""

import io
import os
import shutil
from pathlib import Path

from study.publish.site import evidence, gallery, reference
from study.publish.texts import HERE, load_figures
from study.run.files import open_folder_replacement
from study.run.store import Results, StudyError

ROOT = Path(__file__).resolve().parents[3]
GUIDE = ROOT / "docs"
STATIC = Path(__file__).with_name("static")
KIND = "a site"

# The theme's script is a module that imports another
_MODULE = '<script type="module"', "<script defer"
_IMPORT = 'import * as Gumshoe from "./gumshoe-patched.js";'


def build(results: Results, out: Path, jobs: int = 1) -> list[str]:
    """Write the site into a folder, in place of what an earlier build left there.

    Returns:
        What is missing or wrong, a line for each.

    Raises:
        ForeignFileOrFolder: If something else is there, or something more than that build left.
        StudyError: If claims or the index of figures are missing, or an example fails.
    """
    results.claims()  # what is missing is to be known now, not after the gallery
    load_figures(results)
    out.parent.mkdir(parents=True, exist_ok=True)
    with open_folder_replacement(out, KIND) as made:
        source = made.scratch / "source"
        missing = write_sources(results, source, jobs)
        missing += _sphinx(source, made.folder)
        missing += evidence.copy_data(results, made.folder)
    return missing


def write_sources(results: Results, source: Path, jobs: int = 1) -> list[str]:
    """Write what Sphinx makes pages of; return what is missing."""
    shutil.copytree(GUIDE, source)
    shutil.copytree(STATIC, source / "_static", dirs_exist_ok=True)
    shutil.copy(HERE / "formula.css", source / "_static")
    shutil.copy(Path(__file__).with_name("conf.py"), source)
    _about(source)
    used = gallery.write(results.folder / "gallery", source / "gallery", jobs)
    reference.write(source / "reference", used)
    return evidence.write(results, source)


def _about(source: Path) -> None:
    """Write the page of source, licence and citation."""
    commit = os.environ.get("PW_ELEMENTS_COMMIT", "")
    made = f" These pages are made of commit `{commit[:10]}`." if commit else ""
    parts = {
        "Source": "Links named [source], in the reference, show the code of all modules." + made,
        "How to cite": f"```yaml\n{(ROOT / 'CITATION.cff').read_text('utf-8')}```",
        "Licence": (ROOT / "LICENSE").read_text("utf-8"),
    }
    text = "\n\n".join(f"## {head}\n\n{body}" for head, body in parts.items())
    (source / "about.md").write_text(f"# Source, licence, citation\n\n{text}\n", encoding="utf-8")


def _sphinx(source: Path, pages: Path) -> list[str]:
    """Make the pages; return Sphinx' warnings."""
    try:
        from sphinx.application import Sphinx
        from sphinx.util.console import nocolor
        from sphinx.util.docutils import docutils_namespace, patch_docutils
    except ImportError as error:
        raise StudyError(f"the site needs Sphinx: start it by ./run site ({error})") from None
    nocolor()
    told = io.StringIO()
    with patch_docutils(), docutils_namespace():
        doctrees = source / ".doctrees"
        app = Sphinx(
            str(source), str(source), str(pages), str(doctrees), "html", status=None, warning=told
        )
        app.build()
    shutil.rmtree(pages / "_sources", ignore_errors=True)
    _without_modules(pages)
    lines = told.getvalue().replace(f"{source}/", "").splitlines()
    return [line for line in lines if line.strip()]


def _without_modules(pages: Path) -> None:
    """Have the theme's script loaded in one piece: pages opened as files may not load modules."""
    for page in pages.rglob("*.html"):
        page.write_text(page.read_text("utf-8").replace(*_MODULE), "utf-8")
    scripts = pages / "_static" / "scripts"
    furo = (scripts / "furo.js").read_text("utf-8")
    if _IMPORT in furo:
        patched = (scripts / "gumshoe-patched.js").read_text("utf-8")
        (scripts / "furo.js").write_text(patched + furo.replace(_IMPORT, ""), "utf-8")
