"""Test that figures are reproducible, redrawn only if needed, and drawn despite failing scripts."""

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
from figures.__main__ import (
    cited_figures,
    draw_outdated_figures,
    list_script_and_description_by_figure,
    main,
    normalise_figure_name,
)
from figures.drawing import list_names_of_all_figures, load_figure_script
from study.judge.claims import PAPER_CLAIMS_FILE, Claim, read_claims
from study.publish.plots.style import (
    COLUMN_WIDTH,
    ELEMENT_LOOK,
    draw_quadratic_mesh_with_nodes,
    study_style,
)
from study.run.cases import SECTIONS
from study.run.store import Result, save

ROOT = Path(__file__).parents[2]

FIGURE_SCRIPT_SOURCE = '''"""Force over place.

More about it.
"""

import matplotlib.pyplot as plt

from study.judge.claims import PAPER_CLAIMS_FILE, Claim, read_claims
from study.publish.plots.style import COLUMN_WIDTH, ELEMENT_LOOK

NEEDS = ["1/a"]
SECTION = "1"


def draw(results):
    figure, ax = plt.subplots(figsize=(COLUMN_WIDTH, 2.0))
    curves = results.curves("1/a")
    ax.plot(curves["x"], curves["x"] ** 2, **ELEMENT_LOOK["pw-T6"])
    ax.legend()
    return figure


def caption(results):
    return f"Its scalar is {results.scalar('1/a', 'y'):.1f}."


def alt(results):
    return "A parabola"
'''


def store_toy_result(results_folder, case, y, **curves):
    save(results_folder, "1", case, Result({"y": y}, {"y": "1"}, curves), {"problem": "toy"}, {})


@pytest.fixture
def results_folder(tmp_path):
    store_toy_result(tmp_path / "out", "a", 2.5, x=np.linspace(0, 1, 5))
    return tmp_path / "out"


@pytest.fixture
def add_figure_script(tmp_path, monkeypatch):
    """Return a function that adds a figure script, and hide the project's own scripts."""
    folder = tmp_path / "scripts"
    folder.mkdir()
    monkeypatch.setattr(figures, "__path__", [*figures.__path__, str(folder)])
    monkeypatch.setattr("figures.__main__.list_names_of_all_figures", lambda: sorted(added_names))
    added_names = []

    def add(name, replaced="", replacement=""):
        assert replaced in FIGURE_SCRIPT_SOURCE
        added_names.append(name)
        (folder / f"{name}.py").write_text(
            FIGURE_SCRIPT_SOURCE.replace(replaced, replacement)
            if replaced
            else FIGURE_SCRIPT_SOURCE
        )

    return add


def read_indexed_figure_names(results_folder):
    return [
        entry["name"]
        for entry in json.loads((results_folder / "figures" / "index.json").read_text())
    ]


def draw_and_list_redrawn_figures(results_folder, *names):
    """Draw all figures; return the names of those that were redrawn.

    The files are emptied beforehand, so that files of figures that are not redrawn stay empty.
    """
    paths_by_name = {name: results_folder / "figures" / f"{name}.svg" for name in names}
    for path in paths_by_name.values():
        path.write_text("")
    assert draw_outdated_figures(results_folder, require_all_results=False)
    return [name for name, picture in paths_by_name.items() if picture.stat().st_size > 0]


def test_figures_are_redrawn_only_if_their_script_or_results_change(
    results_folder, add_figure_script
):
    toy_names = ("toy_one", "toy_two", "toy_whole")
    store_toy_result(results_folder, "b", 1.0, x=np.linspace(0, 1, 3))
    add_figure_script("toy_one")
    add_figure_script("toy_two", '"1/a"', '"1/b"')
    add_figure_script("toy_whole", "alt(results):\n", "alt(results):\n    results.section('1')\n")
    assert draw_outdated_figures(results_folder, require_all_results=True)
    assert draw_and_list_redrawn_figures(results_folder, *toy_names) == []
    add_figure_script("toy_one", "A parabola", "The parabola")
    assert draw_and_list_redrawn_figures(results_folder, *toy_names) == ["toy_one"]
    result_path = results_folder / "1" / "b.json"
    result_path.write_text(result_path.read_text() + "\n")
    assert draw_and_list_redrawn_figures(results_folder, *toy_names) == ["toy_two", "toy_whole"]
    store_toy_result(results_folder, "c", 1.0)
    assert draw_and_list_redrawn_figures(results_folder, *toy_names) == ["toy_whole"]
    (results_folder / "figures" / "index.json").unlink()
    assert draw_and_list_redrawn_figures(results_folder, *toy_names) == []
    assert {*read_indexed_figure_names(results_folder)} == {*toy_names}
    result_path.unlink()  # is an error only if the results are stated to be complete
    assert not draw_outdated_figures(results_folder, require_all_results=True)
    assert draw_outdated_figures(results_folder, require_all_results=False)
    assert "toy_two" not in read_indexed_figure_names(results_folder)


@pytest.mark.parametrize(
    ("value_expression", "store_call"),
    [
        ("results.scalar('1/a', 'y')", "store('a', 3.5)"),
        ("results.scalar('1/b', 'y') if '1/b' in results else 0.0", "store('b', 3.5)"),
        ("sum(one.scalars['y'] for one in results.section('1'))", "store('b', 1.0)"),
    ],
)
def test_figure_is_drawn_again_if_a_result_arrives_during_drawing(
    results_folder, add_figure_script, value_expression, store_call
):
    """A figure is drawn again if another process stores a result during its first drawing.

    The first drawing shows the numbers that were read before the result was stored.
    """
    late_storing_source = (
        "def caption(results):\n"
        "    import numpy as np\n"
        "    from study.run.store import Result, save\n"
        f"    said = f'It is {{{value_expression}:.1f}}.'\n"
        "    def store(case, y):\n"
        "        if f'{y}' not in said:\n"
        "            result = Result({'y': y}, {'y': '1'}, {'x': np.linspace(0, 1, 5)})\n"
        "            save(results.folder, '1', case, result, {'problem': 'toy'}, {})\n"
        f"    {store_call}\n"
        "    return said\n\n\n"
        "def caption_before(results):"
    )
    add_figure_script("toy_late", "def caption(results):", late_storing_source)
    for _ in range(2):  # the first drawing must not count as up to date
        assert draw_outdated_figures(results_folder, require_all_results=False)
    (entry,) = json.loads((results_folder / "figures" / "index.json").read_text())
    assert entry["caption"] == "It is 3.5."


def test_results_go_beside_the_figure_if_the_project_is_read_only(
    tmp_path, add_figure_script, monkeypatch, capfd
):
    """If the project's results cannot be written, the command demands another folder.

    With `--out`, needed results are computed in a subfolder beside the figures; with `--results`,
    they are computed in the named folder. In this test, results cannot be written because `results`
    is a file.
    """
    (tmp_path / "results").write_text("no folder")
    monkeypatch.setattr("figures.__main__.ROOT", tmp_path)
    compute_calls = []

    def compute(names, results, jobs):
        assert jobs == 1
        compute_calls.append((names, results))
        store_toy_result(results, "a", 2.5, x=np.linspace(0, 1, 5))
        return True

    monkeypatch.setattr("figures.__main__._compute_needed_results", compute)
    add_figure_script("toy_one")
    assert main(["toy_one"]) == 2
    assert "results cannot be written: name another folder by --results" in capfd.readouterr().err
    assert main(["toy_one", "--out", str(tmp_path / "drawn")]) == 0
    assert main(["toy_one", "--results", str(tmp_path / "mine")]) == 0
    for folder in ("drawn", "mine/figures"):
        assert (tmp_path / folder / "toy_one.png").is_file()
    assert compute_calls == [
        (["toy_one"], tmp_path / "drawn" / "results"),
        (["toy_one"], tmp_path / "mine"),
    ]


def test_svg_ids_do_not_depend_on_the_hash_seed():
    use_elements = "".join(f'<use href="#p{name}"/>' for name in "abcdefgh")
    code = (
        "from figures.drawing import _remove_redundant_svg_parts as clean; "
        f"print(clean('<svg>{use_elements}</svg>'))"
    )

    def strip_in_process(seed):
        environment = os.environ | {"PYTHONHASHSEED": seed}
        command = [sys.executable, "-c", code]
        return subprocess.run(command, env=environment, capture_output=True, check=True).stdout

    assert strip_in_process("1") == strip_in_process("2")


def test_figure_is_indexed_and_its_svg_is_reproducible_without_unused_ids(
    results_folder, add_figure_script
):
    add_figure_script("toy_same")
    drawings = []
    for _ in range(2):
        assert draw_outdated_figures(results_folder, require_all_results=False)
        assert plt.get_fignums() == []
        suffixes = ("json", "narrow.svg", "svg")
        files = ["index.json", *(f"toy_same.{kind}" for kind in suffixes)]
        assert sorted(os.listdir(results_folder / "figures")) == files
        pictures = [
            results_folder / "figures" / f"toy_same.{suffix}" for suffix in ("svg", "narrow.svg")
        ]
        drawings.append([picture.read_bytes() for picture in pictures])
        pictures[0].write_text("")
        (results_folder / "figures" / "toy_same.json").unlink()
    assert drawings[0] == drawings[1]
    (entry,) = json.loads((results_folder / "figures" / "index.json").read_text())
    assert entry == {
        "name": "toy_same", "title": "Force over place", "section": "1", "alt": "A parabola",
        "caption": "Its scalar is 2.5.", "width": 336, "height": 192, "narrow": [336, 192],
    }  # fmt: skip
    svg = drawings[0][0].decode()
    assert "font-family:'DejaVu Sans', sans-serif" in svg
    assert ">new T6<" in svg
    assert ELEMENT_LOOK["pw-T6"]["color"].lower() in svg
    assert not re.search(r'<dc:date>|font:|id="(figure|axes|patch|text|line2d)_', svg)
    used_ids = set(re.findall(r'(?:href="|url\()#([^")]+)', svg))
    assert used_ids
    assert used_ids == set(re.findall(r'id="([^"]+)"', svg))


WIDE_FIGURE_OLD_AND_NEW_CODE = (
    "figsize=(COLUMN_WIDTH, 2.0))",
    "ncols=2, figsize=(2 * COLUMN_WIDTH, 2.6), sharey=True)",
)


def test_wide_figure_has_a_narrow_twin_with_its_panels_below_each_other(
    results_folder, add_figure_script
):
    add_figure_script("toy_wide", *WIDE_FIGURE_OLD_AND_NEW_CODE)
    path = results_folder.parent / "scripts" / "toy_wide.py"
    text = path.read_text().replace("figure, ax =", "figure, (ax, other) =")
    legend_entries = "2 * ax.lines[:1], [20 * 'm', 20 * 'n']"
    legend = f"figure.legend({legend_entries}, loc='outside lower center', ncols=2)"
    path.write_text(text.replace("ax.legend()", f"other.set(xlabel='place'); {legend}"))
    assert draw_outdated_figures(results_folder, require_all_results=False)
    (entry,) = json.loads((results_folder / "figures" / "index.json").read_text())
    assert entry["width"] == 672
    width, height = entry["narrow"]
    assert width <= 358  # CSS pixels available on a phone's screen of 390 pixels
    assert height > entry["height"]
    narrow_svg, wide_svg = (
        (results_folder / "figures" / f"toy_wide.{suffix}").read_text()
        for suffix in ("narrow.svg", "svg")
    )
    assert wide_svg.count(">0.0<") == 3  # one on each x axis and one on the shared y axis
    assert narrow_svg.count(">0.0<") == 4
    label_positions = re.findall(r'x="([-.\d]+)" y="[-.\d]+">(?:m{20}|n{20})<', narrow_svg)
    assert len(label_positions) == 2
    assert label_positions[0] == label_positions[1]  # stacked, too wide for one row


def test_figures_without_their_results_are_skipped_and_reported(
    results_folder, add_figure_script, capsys
):
    add_figure_script("toy_ready")
    add_figure_script("toy_wants", '"1/a"]', '"1/a", "7.5/x"]')
    assert draw_outdated_figures(results_folder, require_all_results=False)
    assert capsys.readouterr().err == "figures: toy_wants: not drawn, for want of 7.5/x\n"
    assert read_indexed_figure_names(results_folder) == ["toy_ready"]
    for number in range(2, 6):
        add_figure_script(f"toy_many{number}", '"1/a"', f'"{number}/a"')
    assert draw_outdated_figures(results_folder, require_all_results=False)
    message = "figures: 5 not drawn, for want of results of sections 2, 3, 4, 5, 7.5\n"
    assert capsys.readouterr().err == message


@pytest.mark.parametrize(
    ("replaced_code", "faulty_code", "expected_error"),
    [
        ("figure, ax =", "1 / 0 #", "ZeroDivisionError: division by zero"),
        ("'y'", "'z'", "no scalar 'z'"),
        ("import matplotlib", "import no_such_matplotlib", "ModuleNotFoundError"),
    ],
)
def test_failing_script_does_not_prevent_other_figures(
    results_folder, add_figure_script, capsys, replaced_code, faulty_code, expected_error
):
    name = f"toy_bad{len(expected_error)}"
    add_figure_script(name, replaced_code, faulty_code)
    add_figure_script("toy_z_good")
    assert not draw_outdated_figures(results_folder, require_all_results=False)
    errors = capsys.readouterr().err
    assert errors.startswith(f"figures: {name}: ")
    assert expected_error in errors
    assert read_indexed_figure_names(results_folder) == ["toy_z_good"]
    assert plt.get_fignums() == []


def test_each_figure_and_table_of_the_paper_has_a_name_and_a_script():
    paper_names = [*(f"fig{n:02}" for n in range(1, 26)), "tab01", "tab02"]
    assert list(list_script_and_description_by_figure())[:27] == paper_names
    for name in paper_names:
        script_name, _ = list_script_and_description_by_figure()[name]
        first_number, *last_numbers = (int(part) for part in re.findall(r"\d+", script_name))
        assert first_number <= int(name[3:]) <= (last_numbers or [first_number])[0], (
            name,
            script_name,
        )


@pytest.mark.parametrize(
    ("typed_name", "name"),
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
def test_name_of_figure_may_be_typed_as_the_paper_cites_it(typed_name, name):
    assert normalise_figure_name(typed_name) == name
    assert name in list_script_and_description_by_figure()


def test_unknown_figure_name_gets_a_suggestion(capfd):
    assert main(["s7_1_sawtoth"]) == 2
    assert "there is no figure s7_1_sawtoth; did you mean s7_1_sawtooth" in capfd.readouterr().err


@pytest.mark.parametrize(
    ("source", "figure_names"),
    [
        ("Abstract; section 7.1, Fig. 5", {"fig05"}),
        ("Section 7.5, Figs 16, 18, 20, 22 (implied)", {"fig16", "fig18", "fig20", "fig22"}),
        ("Section 7.2, Figs 7 and 8 (implied)", {"fig07", "fig08"}),
        ("Figs 16-18", {"fig16", "fig17", "fig18"}),
        ("Section 7.6, Table 2", {"tab02"}),
        ("Section 7.6", set()),
    ],
)
def test_figures_cited_by_the_source_of_a_claim_are_found(source, figure_names):
    assert cited_figures(Claim("x", "paper", source, "", None)) == figure_names


def test_figures_command_prints_caption_and_verdicts_of_claims(
    results_folder, add_figure_script, monkeypatch, capsys
):
    add_figure_script("toy_told")
    claims = read_claims([PAPER_CLAIMS_FILE])[:1]
    monkeypatch.setattr("figures.__main__.load_paper_claims", lambda: claims)
    monkeypatch.setattr("figures.__main__.cited_figures", lambda _: {"toy_told"})
    monkeypatch.setattr("figures.__main__._compute_needed_results", lambda *_: True)
    assert main(["toy_told", "--results", str(results_folder)]) == 0
    printed = capsys.readouterr().out
    assert "Its scalar is 2.5." in printed
    assert "expected < 0.75 ± 0, computed missing: not judged (consistent by" in printed


def test_status_is_1_for_a_missing_case_and_2_for_an_unknown_figure(
    tmp_path, add_figure_script, capfd
):
    add_figure_script("toy_never", '"1/a"', '"7.1/never"')
    folders = ["--results", str(tmp_path / "mine"), "--out", str(tmp_path / "drawn")]
    assert main(["toy_never", *folders]) == 1
    assert capfd.readouterr().err == "study: there is no case 7.1/never: see ./run study list\n"
    assert not (tmp_path / "drawn").exists()
    assert main(["nonsense"]) == 2
    assert "there is no figure nonsense. All names:\nfig01 " in capfd.readouterr().err


def test_foreign_files_are_not_overwritten_and_own_drawings_are(
    results_folder, add_figure_script, tmp_path, monkeypatch, capsys
):
    add_figure_script("toy_mine")
    monkeypatch.setattr(
        "figures.__main__._compute_needed_results", lambda *_: compute_calls.append(1) or True
    )
    compute_calls, drawings_folder = [], tmp_path / "drawn"
    arguments = ["toy_mine", "--results", str(results_folder), "--out", str(drawings_folder)]
    drawings_folder.mkdir()
    (drawings_folder / "toy_mine.pdf").write_bytes(b"%PDF mine")
    assert main(arguments) == 2
    assert "toy_mine.pdf is there, and was not written by pw_elements" in capsys.readouterr().err
    assert (compute_calls, os.listdir(drawings_folder)) == ([], ["toy_mine.pdf"])
    (drawings_folder / "toy_mine.pdf").unlink()
    for _ in range(2):
        assert main(arguments) == 0
    assert sorted(os.listdir(drawings_folder)) == ["toy_mine.pdf", "toy_mine.png"]


def test_figure_with_a_corrupt_result_is_skipped_like_one_with_a_missing_result(
    results_folder, add_figure_script, capsys
):
    add_figure_script("toy_corrupt")
    (results_folder / "1" / "a.json").write_text("{")
    assert draw_outdated_figures(results_folder, require_all_results=False)
    assert capsys.readouterr().err == "figures: toy_corrupt: not drawn, for want of 1/a\n"


def test_every_figure_script_defines_title_results_section_and_functions():
    for name in list_names_of_all_figures():
        loaded_script = load_figure_script(name)
        assert loaded_script.title != name
        assert loaded_script.needs, name
        assert loaded_script.section in SECTIONS
        assert all(
            callable(getattr(loaded_script, function_name))
            for function_name in ("draw", "caption", "alt")
        ), name


def test_looks_of_elements_are_distinct_and_contrast_with_white():
    assert {"galerkin-T6", "pw-T6", "pwsym-T6", "galerkin-Q8", "pw-Q8", "pw-Q9"} < set(ELEMENT_LOOK)
    for key in ("color", "marker", "label"):
        assert len({look[key] for look in ELEMENT_LOOK.values()}) == len(ELEMENT_LOOK)
    for look in ELEMENT_LOOK.values():  # contrast ratio to white
        linear_rgb = ((np.array(to_rgb(look["color"])) + 0.055) / 1.055) ** 2.4
        assert 1.05 / (linear_rgb @ [0.2126, 0.7152, 0.0722] + 0.05) > 2.3


def plot_mesh_and_list_sides_and_nodes(node_positions, cells):
    with study_style():
        figure, ax = plt.subplots(figsize=(COLUMN_WIDTH, 2))
        draw_quadratic_mesh_with_nodes(ax, np.array(node_positions), np.array(cells))
        sides = [segment.round(9) for segment in ax.collections[0].get_segments()]
        nodes = [np.column_stack(line.get_data()).round(9) for line in ax.lines]
        plt.close(figure)
    return sides, nodes


def test_plotted_cell_sides_pass_through_mid_side_nodes_for_any_numbering():
    x = [[0, 0], [2, 0], [0, 2], [1, 0.3], [1.2, 1.2], [-0.1, 1]]
    for cell in ([0, 1, 2, 3, 4, 5], [0, 1, 2, 4, 5, 3], [2, 0, 1, 3, 4, 5]):
        sides, (corners, middles) = plot_mesh_and_list_sides_and_nodes(x, [cell])
        assert len(sides) == 3
        assert {tuple(side[4]) for side in sides} == {(1, 0.3), (1.2, 1.2), (-0.1, 1)}
        end_points = {frozenset([tuple(side[0]), tuple(side[-1])]) for side in sides}
        assert len(end_points) == 3
        assert next(side for side in sides if tuple(side[4]) == (1, 0.3))[:, 0].max() == 2
        assert len(corners) == len(middles) == 3
