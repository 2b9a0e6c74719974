"""Read mesh files in child processes under limits of CPU time and memory.

`python3 -m tests.library.limited_reading COMPARISON FILE ...` reads files one after the other, and
prints a line of JSON for each. The process ends if a file takes more than
`MAX_CPU_SECONDS_PER_FILE`. COMPARISON is the name "module:name" of a function whose arguments are a
mesh and the path of its file. It returns a description of their differences.
"""

import json
import logging
import resource
import signal
import subprocess
import sys
import time
import traceback
from importlib import import_module
from pathlib import Path

MAX_CPU_SECONDS_PER_FILE, MAX_MEGABYTES_OF_MEMORY_PER_FILE = 2.0, 500
ROOT = Path(__file__).parents[2]
# Includes address space that the libraries reserve without using it
_MAX_ADDRESS_SPACE_BYTES = 8_000_000_000


def read_files_under_cpu_and_memory_limits(paths, comparison_name):
    """Read files in child processes, and return a dictionary of results for each path.

    The value of "outcome" is "read", "refused" (by ValueError or FileNotFoundError), "raw error" or
    "died". Further keys are "message", "seconds", "megabytes" and "differences". If reading a file
    ends the process, another process reads the remaining files.
    """
    results, remaining = {}, [*paths]
    while remaining:
        command = [sys.executable, "-m", "tests.library.limited_reading", comparison_name]
        run = subprocess.run(
            [*command, *map(str, remaining)], cwd=ROOT, capture_output=True, text=True
        )
        lines = [json.loads(line) for line in run.stdout.splitlines() if line.startswith("{")]
        results |= dict(zip(remaining, lines, strict=False))
        if run.returncode == 0:
            assert len(lines) == len(remaining)
            break
        assert len(lines) < len(remaining), run.stderr
        message = f"exit code {run.returncode}: {run.stderr[-300:]}"
        results[remaining[len(lines)]] = {"outcome": "died", "message": message}
        remaining = remaining[len(lines) + 1 :]
    return results


def _read_file_and_measure_resources(path, compare):
    from mpi4py import MPI

    from pw_elements.meshes import from_file

    result, part = {"message": "", "differences": ""}, None
    Path("/proc/self/clear_refs").write_text("5")  # resets the peak of memory
    megabytes, start = _read_process_memory_in_mb("VmRSS"), time.process_time()
    signal.setitimer(signal.ITIMER_PROF, MAX_CPU_SECONDS_PER_FILE)  # its signal ends the process
    try:
        part = from_file(path, MPI.COMM_SELF)
        result["outcome"] = "read"
    except (ValueError, FileNotFoundError) as error:
        result["outcome"], result["message"] = "refused", str(error)
    except BaseException:
        result["outcome"], result["message"] = "raw error", traceback.format_exc()
    signal.setitimer(signal.ITIMER_PROF, 0)
    result["seconds"] = round(time.process_time() - start, 3)
    result["megabytes"] = _read_process_memory_in_mb("VmHWM") - megabytes
    if part is not None:
        try:
            result["differences"] = compare(part, path)
        except Exception:
            result["differences"] = traceback.format_exc()
    return result


def _read_process_memory_in_mb(status_key):
    """Return the memory size of this process with the given key, for example "VmHWM", in MB."""
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith(status_key):
            return int(line.split()[1]) // 1000
    raise KeyError(status_key)


def print_reading_results(comparison_name, paths):
    module, _, name = comparison_name.partition(":")
    compare = getattr(import_module(module), name)
    logging.disable()
    signal.signal(signal.SIGPROF, signal.SIG_DFL)
    for path in paths:
        print(json.dumps(_read_file_and_measure_resources(Path(path), compare)), flush=True)


if __name__ == "__main__":
    resource.setrlimit(resource.RLIMIT_AS, (_MAX_ADDRESS_SPACE_BYTES, _MAX_ADDRESS_SPACE_BYTES))
    print_reading_results(sys.argv[1], sys.argv[2:])
