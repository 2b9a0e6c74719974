"""Starts the command line under its supervisor."""

from study.run.supervisor import run_supervised


def _run() -> int:
    from study.publish.command import main  # slow to import, which a signal may interrupt, too

    return main()


if __name__ == "__main__":
    run_supervised(_run, "study")
