"""Run the study and draw its figures; this is the command line of `./run study`.

Without drawing figures, `python3 -m study` does the same; it uses figures drawn earlier.
"""

from pathlib import Path

from study.run.supervisor import run_supervised


def _run() -> int:
    from study.publish.command import FigureDrawing, main  # slow; imported under the supervisor

    return main(
        figures=FigureDrawing(
            "figures.drawing:list_needed_results", "figures.drawing:update_figure", _draw_all
        )
    )


def _draw_all(folder: Path, complete: bool, jobs: int) -> bool:
    from figures.__main__ import draw_all  # imports Matplotlib, which some commands do not need

    return draw_all(folder, complete, jobs)


if __name__ == "__main__":
    run_supervised(_run, "study")
