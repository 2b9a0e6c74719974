"""Drawing: the same bytes each time, whole files, and no figure lost to another's fault."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.colors import to_rgb

import figures
from figures.__main__ import cited_figures, draw_all, list_figure_names, main, normalise_name
from figures.drawing import load_script, scripts
from study.judge.claims import FILE, Claim, read_claims
from study.publish.plots.style import COLUMN, LOOK, mesh_plot, style
from study.run.cases import SECTIONS
from study.run.store import Result, save

ROOT = Path(__file__).parents[2]

SCRIPT = '''"""Force over place.

More about it.
"""

import matplotlib.pyplot as plt

from study.judge.claims import FILE, Claim, read_claims
from study.publish.plots.style import COLUMN, LOOK

NEEDS = ["1/a"]
SECTION = "1"


def draw(results):
    figure, ax = plt.subplots(figsize=(COLUMN, 2.0))
    curves = results.curves("1/a")
    ax.plot(curves["x"], curves["x"] ** 2, **LOOK["pw-T6"])
    ax.legend()
    return figure


def caption(results):
    return f"Its scalar is {results.scalar('1/a', 'y'):.1f}."


def alt(results):
    return "A parabola"
'''


def store(out, case, y, **curves):
    save(out, "1", case, Result({"y": y}, {"y": "1"}, curves), {"problem": "toy"}, {})


@pytest.fixture
def out(tmp_path):
    store(tmp_path / "out", "a", 2.5, x=np.linspace(0, 1, 5))
    return tmp_path / "out"


@pytest.fixture
def script(tmp_path, monkeypatch):
    """A function that adds a figure script; no others exist."""
    folder = tmp_path / "scripts"
    folder.mkdir()
    monkeypatch.setattr(figures, "__path__", [*figures.__path__, str(folder)])
    monkeypatch.setattr("figures.__main__.scripts", lambda: sorted(added))
    added = []

    def add(name, old="", new=""):
        assert old in SCRIPT
        added.append(name)
        (folder / f"{name}.py").write_text(SCRIPT.replace(old, new) if old else SCRIPT)

    return add


def names(out):
    return [entry["name"] for entry in json.loads((out / "figures" / "index.json").read_text())]


def drawn_of(out, *names):
    """Which of the figures the next call draws: a file made empty beforehand has content again."""
    pictures = {name: out / "figures" / f"{name}.svg" for name in names}
    for picture in pictures.values():
        picture.write_text("")
    assert draw_all(out, complete=False)
    return [name for name, picture in pictures.items() if picture.stat().st_size > 0]


def test_figures_are_drawn_again_only_after_a_change_of_their_own(out, script):
    toys = ("toy_one", "toy_two", "toy_whole")
    store(out, "b", 1.0, x=np.linspace(0, 1, 3))
    script("toy_one")
    script("toy_two", '"1/a"', '"1/b"')
    script("toy_whole", "alt(results):\n", "alt(results):\n    results.section('1')\n")
    assert draw_all(out, complete=True)
    assert drawn_of(out, *toys) == []
    script("toy_one", "A parabola", "The parabola")
    assert drawn_of(out, *toys) == ["toy_one"]
    result = out / "1" / "b.json"
    result.write_text(result.read_text() + "\n")
    assert drawn_of(out, *toys) == ["toy_two", "toy_whole"]
    store(out, "c", 1.0)
    assert drawn_of(out, *toys) == ["toy_whole"]
    (out / "figures" / "index.json").unlink()
    assert drawn_of(out, *toys) == []
    assert {*names(out)} == {*toys}
    result.unlink()  # a failure only where all is said to be there
    assert not draw_all(out, complete=True)
    assert draw_all(out, complete=False)
    assert "toy_two" not in names(out)


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ("results.scalar('1/a', 'y')", "store('a', 3.5)"),
        ("results.scalar('1/b', 'y') if '1/b' in results else 0.0", "store('b', 3.5)"),
        ("sum(one.scalars['y'] for one in results.section('1'))", "store('b', 1.0)"),
    ],
)
def test_results_that_arrive_while_a_figure_is_drawn_are_not_passed_over(
    out, script, before, after
):
    """Others compute while a figure is drawn: what it has not read is not what it shows."""
    store_late = (
        "def caption(results):\n"
        "    import numpy as np\n"
        "    from study.run.store import Result, save\n"
        f"    said = f'It is {{{before}:.1f}}.'\n"
        "    def store(case, y):\n"
        "        if f'{y}' not in said:\n"
        "            result = Result({'y': y}, {'y': '1'}, {'x': np.linspace(0, 1, 5)})\n"
        "            save(results.folder, '1', case, result, {'problem': 'toy'}, {})\n"
        f"    {after}\n"
        "    return said\n\n\n"
        "def caption_before(results):"
    )
    script("toy_late", "def caption(results):", store_late)
    for _ in range(2):  # the note of the first drawing does not hold
        assert draw_all(out, complete=False)
    (entry,) = json.loads((out / "figures" / "index.json").read_text())
    assert entry["caption"] == "It is 3.5."


def test_figures_need_no_writable_project(tmp_path, script, monkeypatch, capfd):
    """In a clone that is read-only, results go beside the figure."""
    (tmp_path / "results").write_text("no folder")
    monkeypatch.setattr("figures.__main__.ROOT", tmp_path)
    computed = []

    def compute(names, results, jobs):
        assert jobs == 1
        computed.append((names, results))
        store(results, "a", 2.5, x=np.linspace(0, 1, 5))
        return True

    monkeypatch.setattr("figures.__main__._compute_needed_results", compute)
    script("toy_one")
    assert main(["toy_one"]) == 2
    assert "results cannot be written: name another folder by --results" in capfd.readouterr().err
    assert main(["toy_one", "--out", str(tmp_path / "drawn")]) == 0
    assert main(["toy_one", "--results", str(tmp_path / "mine")]) == 0
    for folder in ("drawn", "mine/figures"):
        assert (tmp_path / folder / "toy_one.png").is_file()
    assert computed == [
        (["toy_one"], tmp_path / "drawn" / "results"),
        (["toy_one"], tmp_path / "mine"),
    ]


def test_names_in_drawings_are_those_of_other_processes():
    uses = "".join(f'<use href="#p{name}"/>' for name in "abcdefgh")
    code = f"from figures.drawing import _strip_svg; print(_strip_svg('<svg>{uses}</svg>'))"

    def drawn(seed):
        settings = os.environ | {"PYTHONHASHSEED": seed}
        command = [sys.executable, "-c", code]
        return subprocess.run(command, env=settings, capture_output=True, check=True).stdout

    assert drawn("1") == drawn("2")


def test_figure_is_indexed_and_drawn_each_time_the_same_with_what_is_shown_and_no_more(out, script):
    script("toy_same")
    drawn = []
    for _ in range(2):
        assert draw_all(out, complete=False)
        assert plt.get_fignums() == []
        kinds = ("json", "narrow.svg", "svg")
        files = ["index.json", *(f"toy_same.{kind}" for kind in kinds)]
        assert sorted(os.listdir(out / "figures")) == files
        pictures = [out / "figures" / f"toy_same.{kind}" for kind in ("svg", "narrow.svg")]
        drawn.append([picture.read_bytes() for picture in pictures])
        pictures[0].write_text("")
        (out / "figures" / "toy_same.json").unlink()
    assert drawn[0] == drawn[1]
    (entry,) = json.loads((out / "figures" / "index.json").read_text())
    assert entry == {
        "name": "toy_same", "title": "Force over place", "section": "1", "alt": "A parabola",
        "caption": "Its scalar is 2.5.", "width": 336, "height": 192, "narrow": [336, 192],
    }  # fmt: skip
    svg = drawn[0][0].decode()
    assert "font-family:'DejaVu Sans', sans-serif" in svg
    assert ">new T6<" in svg
    assert LOOK["pw-T6"]["color"].lower() in svg
    assert not re.search(r'<dc:date>|font:|id="(figure|axes|patch|text|line2d)_', svg)
    used = set(re.findall(r'(?:href="|url\()#([^")]+)', svg))
    assert used
    assert used == set(re.findall(r'id="([^"]+)"', svg))


WIDE = ("figsize=(COLUMN, 2.0))", "ncols=2, figsize=(2 * COLUMN, 2.6), sharey=True)")


def test_wide_figure_has_a_narrow_twin_with_its_panels_below_each_other(out, script):
    script("toy_wide", *WIDE)
    path = out.parent / "scripts" / "toy_wide.py"
    text = path.read_text().replace("figure, ax =", "figure, (ax, other) =")
    entries = "2 * ax.lines[:1], [20 * 'm', 20 * 'n']"
    legend = f"figure.legend({entries}, loc='outside lower center', ncols=2)"
    path.write_text(text.replace("ax.legend()", f"other.set(xlabel='place'); {legend}"))
    assert draw_all(out, complete=False)
    (entry,) = json.loads((out / "figures" / "index.json").read_text())
    assert entry["width"] == 672
    width, height = entry["narrow"]
    assert width <= 358  # what a telephone's screen of 390 pixels leaves
    assert height > entry["height"]
    narrow, wide = (
        (out / "figures" / f"toy_wide.{kind}").read_text() for kind in ("narrow.svg", "svg")
    )
    assert wide.count(">0.0<") == 3  # both panels' x, one y
    assert narrow.count(">0.0<") == 4
    left = re.findall(r'x="([-.\d]+)" y="[-.\d]+">(?:m{20}|n{20})<', narrow)
    assert len(left) == 2
    assert left[0] == left[1]  # too wide to be beside each other


def test_figures_without_their_results_are_skipped_with_a_line(out, script, capsys):
    script("toy_ready")
    script("toy_wants", '"1/a"]', '"1/a", "7.5/x"]')
    assert draw_all(out, complete=False)
    assert capsys.readouterr().err == "figures: toy_wants: not drawn, for want of 7.5/x\n"
    assert names(out) == ["toy_ready"]
    for number in range(2, 6):
        script(f"toy_many{number}", '"1/a"', f'"{number}/a"')
    assert draw_all(out, complete=False)
    told = "figures: 5 not drawn, for want of results of sections 2, 3, 4, 5, 7.5\n"
    assert capsys.readouterr().err == told


@pytest.mark.parametrize(
    ("old", "new", "line"),
    [
        ("figure, ax =", "1 / 0 #", "ZeroDivisionError: division by zero"),
        ("'y'", "'z'", "no scalar 'z'"),
        ("import matplotlib", "import no_such_matplotlib", "ModuleNotFoundError"),
    ],
)
def test_script_that_fails_costs_no_other(out, script, capsys, old, new, line):
    name = f"toy_bad{len(line)}"
    script(name, old, new)
    script("toy_z_good")
    assert not draw_all(out, complete=False)
    errors = capsys.readouterr().err
    assert errors.startswith(f"figures: {name}: ")
    assert line in errors
    assert names(out) == ["toy_z_good"]
    assert plt.get_fignums() == []


def test_each_of_the_papers_figures_and_tables_has_its_name():
    paper = [*(f"fig{n:02}" for n in range(1, 26)), "tab01", "tab02"]
    assert list(list_figure_names())[:27] == paper
    for name in paper:
        drawn, _ = list_figure_names()[name]
        first, *last = (int(part) for part in re.findall(r"\d+", drawn))
        assert first <= int(name[3:]) <= (last or [first])[0], (name, drawn)


@pytest.mark.parametrize(
    ("typed", "name"),
    [
        ("Fig. 5", "fig05"),
        ("fig5", "fig05"),
        ("fig05", "fig05"),
        ("Figure 16", "fig16"),
        ("Table 1", "tab01"),
        ("tab1", "tab01"),
        ("s7_1_sawtooth", "s7_1_sawtooth"),
    ],
)
def test_name_of_figure_may_be_typed_as_the_paper_cites_it(typed, name):
    assert normalise_name(typed) == name
    assert name in list_figure_names()


def test_unknown_figure_name_gets_a_suggestion(capfd):
    assert main(["s7_1_sawtoth"]) == 2
    assert "there is no figure s7_1_sawtoth; did you mean s7_1_sawtooth" in capfd.readouterr().err


@pytest.mark.parametrize(
    ("source", "names"),
    [
        ("Abstract; section 7.1, Fig. 5", {"fig05"}),
        ("Section 7.5, Figs 16, 18, 20, 22 (implied)", {"fig16", "fig18", "fig20", "fig22"}),
        ("Section 7.2, Figs 7 and 8 (implied)", {"fig07", "fig08"}),
        ("Figs 16-18", {"fig16", "fig17", "fig18"}),
        ("Section 7.6, Table 2", {"tab02"}),
        ("Section 7.6", set()),
    ],
)
def test_figures_that_a_source_cites_are_found(source, names):
    assert cited_figures(Claim("x", "paper", source, "", None)) == names


def test_figure_prints_caption_values_and_verdicts(out, script, monkeypatch, capsys):
    script("toy_told")
    claims = read_claims([FILE])[:1]
    monkeypatch.setattr("figures.__main__.load_paper_claims", lambda: claims)
    monkeypatch.setattr("figures.__main__.cited_figures", lambda _: {"toy_told"})
    monkeypatch.setattr("figures.__main__._compute_needed_results", lambda *_: True)
    assert main(["toy_told", "--results", str(out)]) == 0
    printed = capsys.readouterr().out
    assert "Its scalar is 2.5." in printed
    assert "expected < 0.75 ± 0, computed missing: not judged (consistent by" in printed


def test_figure_whose_result_cannot_be_computed_is_1(tmp_path, script, capfd):
    script("toy_never", '"1/a"', '"7.1/never"')
    folders = ["--results", str(tmp_path / "mine"), "--out", str(tmp_path / "drawn")]
    assert main(["toy_never", *folders]) == 1
    assert capfd.readouterr().err == "study: there is no case 7.1/never: see ./run study list\n"
    assert not (tmp_path / "drawn").exists()
    assert main(["nonsense"]) == 2
    assert "there is no figure nonsense. All names:\nfig01 " in capfd.readouterr().err


def test_files_that_were_not_drawn_are_not_replaced_and_those_that_were_are(
    out, script, tmp_path, monkeypatch, capsys
):
    script("toy_mine")
    monkeypatch.setattr(
        "figures.__main__._compute_needed_results", lambda *_: computed.append(1) or True
    )
    computed, drawn = [], tmp_path / "drawn"
    arguments = ["toy_mine", "--results", str(out), "--out", str(drawn)]
    drawn.mkdir()
    (drawn / "toy_mine.pdf").write_bytes(b"%PDF mine")
    assert main(arguments) == 2
    assert "toy_mine.pdf is there, and was not written by pw_elements" in capsys.readouterr().err
    assert (computed, os.listdir(drawn)) == ([], ["toy_mine.pdf"])
    (drawn / "toy_mine.pdf").unlink()
    for _ in range(2):
        assert main(arguments) == 0
    assert sorted(os.listdir(drawn)) == ["toy_mine.pdf", "toy_mine.png"]


def test_a_figure_whose_result_is_corrupt_is_as_one_whose_result_is_missing(out, script, capsys):
    script("toy_corrupt")
    (out / "1" / "a.json").write_text("{")
    assert draw_all(out, complete=False)
    assert capsys.readouterr().err == "figures: toy_corrupt: not drawn, for want of 1/a\n"


def test_every_script_has_what_the_frame_asks_for():
    for name in scripts():
        script = load_script(name)
        assert script.title != name
        assert script.needs, name
        assert script.section in SECTIONS
        assert all(callable(getattr(script, part)) for part in ("draw", "caption", "alt")), name


def test_looks_are_distinct_and_visible_on_white():
    assert {"galerkin-T6", "pw-T6", "pwsym-T6", "galerkin-Q8", "pw-Q8", "pw-Q9"} < set(LOOK)
    for part in ("color", "marker", "label"):
        assert len({look[part] for look in LOOK.values()}) == len(LOOK)
    for look in LOOK.values():  # contrast to white
        linear = ((np.array(to_rgb(look["color"])) + 0.055) / 1.055) ** 2.4
        assert 1.05 / (linear @ [0.2126, 0.7152, 0.0722] + 0.05) > 2.3


def drawn(x, cells):
    with style():
        figure, ax = plt.subplots(figsize=(COLUMN, 2))
        mesh_plot(ax, np.array(x), np.array(cells))
        sides = [segment.round(9) for segment in ax.collections[0].get_segments()]
        nodes = [np.column_stack(line.get_data()).round(9) for line in ax.lines]
        plt.close(figure)
    return sides, nodes


def test_side_passes_through_its_middle_node_whatever_the_numbering():
    x = [[0, 0], [2, 0], [0, 2], [1, 0.3], [1.2, 1.2], [-0.1, 1]]
    for cell in ([0, 1, 2, 3, 4, 5], [0, 1, 2, 4, 5, 3], [2, 0, 1, 3, 4, 5]):
        sides, (corners, middles) = drawn(x, [cell])
        assert len(sides) == 3
        assert {tuple(side[4]) for side in sides} == {(1, 0.3), (1.2, 1.2), (-0.1, 1)}
        ends = {frozenset([tuple(side[0]), tuple(side[-1])]) for side in sides}
        assert len(ends) == 3
        assert next(side for side in sides if tuple(side[4]) == (1, 0.3))[:, 0].max() == 2
        assert len(corners) == len(middles) == 3
