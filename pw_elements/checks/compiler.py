"""Explain why forms cannot be compiled, if the C compiler or a header is missing."""

import os
import re
import shlex
import subprocess
import sys
import sysconfig


def find_compiler_problem() -> str | None:
    """Compile an empty C program with Python's headers; return the reason if this is impossible.

    The compiler is the one with which FFCx compiles forms: that of the environment variable CC, or
    otherwise the one that has compiled Python. The function does not communicate.
    """
    command = os.environ.get("CC") or sysconfig.get_config_var("CC") or "cc"
    folders = {sysconfig.get_path(name) for name in ("include", "platinclude")}
    options = [f"-I{folder}" for folder in sorted(folders)]
    # an input by a pipe could end this process: PETSc handles SIGPIPE, which Python ignores
    options += ["-fsyntax-only", "-include", "Python.h", "-x", "c", os.devnull]
    try:
        process = subprocess.run(
            [*shlex.split(command), *options],
            stdin=subprocess.DEVNULL,
            env=os.environ | {"LC_ALL": "C"},
            capture_output=True,
            text=True,
            errors="replace",
            check=False,
        )
    except OSError as error:
        reason = f"cannot be started ({error.strerror})"
    else:
        if process.returncode == 0:
            return None
        errors = re.findall(r"error: .*", process.stderr)
        reason = f"does not find them ({errors[0] if errors else process.stderr.strip()})"
    version = f"{sys.version_info.major}.{sys.version_info.minor}"
    return (
        f"forms are compiled with a C compiler and the headers of Python {version}, and the "
        f"compiler '{command}' {reason}: install both, by apt install gcc python{version}-dev "
        "(Debian, Ubuntu) or dnf install gcc python3-devel (Fedora)"
    )
