"""Run the command line of the study in a supervised process, without drawing figures."""

from study.run.supervisor import run_supervised_and_exit


def _run_command_line() -> int:
    from study.publish.command import main  # slow to import, which a signal may interrupt, too

    return main()


if __name__ == "__main__":
    run_supervised_and_exit(_run_command_line, "study")
