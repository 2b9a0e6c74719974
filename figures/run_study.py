"""Run the study and draw its figures: the command line of `./run study`.

`python3 -m study` computes, judges and reports the same, with figures that were drawn before.
"""

from pathlib import Path

from study.run.supervisor import run_supervised


def _run() -> int:
    from study.publish.command import FigureDrawing, main  # slow, and a signal may interrupt it

    return main(
        figures=FigureDrawing(
            "figures.drawing:list_needed_results", "figures.drawing:update_figure", _draw_all
        )
    )


def _draw_all(folder: Path, complete: bool, jobs: int) -> bool:
    from figures.__main__ import draw_all  # imports Matplotlib, which not all commands need

    return draw_all(folder, complete, jobs)


if __name__ == "__main__":
    run_supervised(_run, "study")
