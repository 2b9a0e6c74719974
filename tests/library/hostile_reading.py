"""Reads hostile decks in this process: `python3 -m tests.library.hostile_reading FOLDER SHARE OF`.

The process ends if a deck takes more than two seconds of CPU time, or 500 MB more than before the
first. A line of JSON for each deck says how it ended; a raw error is one of its words.
"""

import json
import os
import resource
import signal
import sys
import traceback
from pathlib import Path

from mpi4py import MPI

from pw_elements.meshes import from_file
from tests.library.hostile_decks import GOOD_DECK, HOSTILE_DECKS
from tests.library.test_decks import check_against_second_reading

SECONDS, MEMORY = 2.0, 500e6


def write(folder, files):
    """Write the files of a deck, text as UTF-8."""
    for name, content in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content if isinstance(content, bytes) else content.encode())


def main(folder, share, of):
    write(folder / "first", {"deck.inp": GOOD_DECK})
    part = from_file(folder / "first" / "deck.inp", MPI.COMM_SELF)
    check_against_second_reading(part, folder / "first" / "deck.inp")  # compiles what it needs
    used = int(Path("/proc/self/statm").read_text().split()[0]) * os.sysconf("SC_PAGE_SIZE")
    resource.setrlimit(resource.RLIMIT_AS, (int(used + MEMORY),) * 2)
    signal.signal(signal.SIGPROF, signal.SIG_DFL)  # which ends the process
    for k, (name, (files, _)) in enumerate(HOSTILE_DECKS.items()):
        if k % of != share:
            continue
        print(json.dumps([name, "begun", ""]), flush=True)
        write(folder / str(k), files)
        path = folder / str(k) / "deck.inp"
        signal.setitimer(signal.ITIMER_PROF, SECONDS)
        try:
            part = from_file(path, MPI.COMM_SELF)
            end, words = "read", ""
        except (ValueError, FileNotFoundError) as error:
            end, words = "refused", str(error)
            if str(path.parent) not in words:
                end, words = "raw", repr(error)
        except Exception:
            end, words = "raw", traceback.format_exc()
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        if end == "read" and sum(map(len, files.values())) < 100_000:
            try:
                check_against_second_reading(part, path)
            except Exception:
                end, words = "another mesh", traceback.format_exc()
        print(json.dumps([name, end, words]), flush=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]))
