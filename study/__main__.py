"""Starts the command line under its supervisor."""

from study.core.supervisor import end_process, supervise


def _run() -> int:
    from study.command import main  # slow to import, which a signal may interrupt, too

    return main()


if __name__ == "__main__":
    end_process(supervise(_run, "study"))
