"""A study whose disk is full: `python3 -m tests.run.full_disk FOLDER` prints what became of it.

Its results lie on a small file system in memory, which nobody else sees and which goes with the
process. Status 77 says that no such thing can be mounted here.
"""

import ctypes
import io
import json
import os
import sys
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path

import pytest

import study.report
from study.core.store import Results
from tests.study.toystudy import install, started

REFUSED = 77


def mount(folder):
    """Mount one megabyte at a folder, as root or as root of a namespace of one's own."""
    folder.mkdir()
    user, group = os.getuid(), os.getgid()
    try:
        os.unshare(os.CLONE_NEWNS | (os.CLONE_NEWUSER if user else 0))
        if user:
            Path("/proc/self/setgroups").write_text("deny")
            Path("/proc/self/uid_map").write_text(f"0 {user} 1")
            Path("/proc/self/gid_map").write_text(f"0 {group} 1")
    except (AttributeError, OSError):  # the former with Python 3.11
        sys.exit(REFUSED)
    libc = ctypes.CDLL(None)
    private = 1 << 18 | 1 << 14  # MS_PRIVATE, MS_REC
    if libc.mount(b"none", b"/", None, private, None) or libc.mount(
        b"none", bytes(folder), b"tmpfs", 0, b"size=1m"
    ):
        sys.exit(REFUSED)


def fill(file):
    with file.open("wb", buffering=0) as stream:
        try:
            while True:
                stream.write(bytes(4096))
        except OSError:
            pass


def stored(out):
    results = Results(out)
    return {case.key: case.scalars for section in "12" for case in results.section(section)}


def run(out, *arguments):
    from study.command import main

    with redirect_stderr(io.StringIO()) as errors, redirect_stdout(io.StringIO()):
        status = main([*arguments, "--out", str(out)])
    return {"status": status, "errors": errors.getvalue(), "stored": stored(out)}


if __name__ == "__main__":
    folder = Path(sys.argv[1])
    out = folder / "results"
    mount(out)
    with pytest.MonkeyPatch.context() as patch:
        install(folder, patch)
        patch.setattr(study.report, "build", lambda *_: [])
        told = {"roomy": run(out, "1", "--jobs", "1")}
        fill(out / "fill")
        told["full"] = run(out, "--force", "--jobs", "2")
        told["litter"] = [str(path) for path in out.rglob(".*")]
        (out / "fill").unlink()
        before = started(folder)
        told["again"] = run(out, "--jobs", "1")
        told["computed again"] = started(folder) - before
    print(json.dumps(told))
