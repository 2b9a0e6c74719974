"""Figures and tables of the study, drawn from stored results.

Running a script directly, e.g. `python3 figures/fig05.py`, is equivalent to `./run figure fig05`.
"""

import sys
from pathlib import Path

_main_file = Path(getattr(sys.modules["__main__"], "__file__", None) or "")
_COMMANDS = {"__main__", "run_study"}
if _main_file.absolute().parent == Path(__file__).parent and _main_file.stem not in _COMMANDS:
    from figures.__main__ import main
    from study.run.supervisor import run_supervised_and_exit

    run_supervised_and_exit(lambda: main([_main_file.stem, *sys.argv[1:]]), "figures")
