"""Run the study and draw its figures; this is the command line of `./run study`.

Without drawing figures, `python3 -m study` does the same; it uses figures drawn earlier.
"""

from pathlib import Path

from study.run.supervisor import run_supervised_and_exit


def _run_command_line_with_figures() -> int:
    from study.publish.command import (
        FigureDrawingFunctions,
        main,
    )  # slow; imported under the supervisor

    return main(
        figures=FigureDrawingFunctions(
            "figures.drawing:list_needed_results",
            "figures.drawing:update_figure",
            _draw_outdated_figures,
        )
    )


def _draw_outdated_figures(folder: Path, complete: bool, jobs: int) -> bool:
    from figures.__main__ import (
        draw_outdated_figures,
    )  # imports Matplotlib, which some commands do not need

    return draw_outdated_figures(folder, complete, jobs)


if __name__ == "__main__":
    run_supervised_and_exit(_run_command_line_with_figures, "study")
