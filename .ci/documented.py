"""Run the commands that README and docs show in `sh` blocks, on stored results of the study.

`python3 .ci/documented.py` runs each line that starts ./run, ~/pw-elements/run, sed or a script of
.ci, and the scripts of `examples` that generate meshes, which neither tests nor gallery run.
Commands that are left out are printed with the reason. The script needs only Python.
"""

import os
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

PROJECT = Path(__file__).resolve().parents[1]
PAGES = [PROJECT / "README.md", PROJECT / "CONTRIBUTING.md", *sorted(PROJECT.glob("docs/**/*.md"))]

# Commands that run in the project's folder, and in a folder of the user
IN_PROJECT = r"(\./run|python3 \.ci/\w+\.py) "
IN_OWN_FOLDER = r"(~/pw-elements/run|sed|\.ci/user-elements) "

LEFT_OUT = {
    r"(sed .* > study/benchmarks/|\./run study V\d+$)": "run by tests/run/test_first_steps.py",
    r"\./run study$": "a step of its own",
    r"\./run site$": "a step of its own",
    r"\./run test\b": "a step of its own",
    r"\./run nightly$": "it takes hours",
    r"\.ci/run\b": "it runs this script",
    r"\.ci/build\b": "run by .ci/package and .ci/pip",
    r"git (tag|push)\b": "they publish a release",
    r"(mkdir|cd)\b": "each command below runs in such a folder",
    r"(sudo apt|python3 -m venv|~/pw/bin/(pip|mpiexec))\b": "changes the system: see .ci/pip",
    r'pip install "\.\[dolfinx\]"$': "a step of its own",
    r"(conda|docker|pip)\b": "needs another system",
    r"pre-commit\b": "changes the checkout's hooks",
}

# Programs in the commands of the pages, and the page that contains their code
PROGRAMS = {"plate.py": "README.md", "punch.py": "docs/how-to/parallel.md"}


def shown_commands(page: Path) -> list[str]:
    """Return the commands of a page's sh blocks, without comments and line continuations."""
    blocks = re.findall(r"^```sh\n(.*?)^```", page.read_text("utf-8"), re.DOTALL | re.MULTILINE)
    lines = "".join(blocks).replace("\\\n", " ").splitlines()
    commands = [re.sub(r"\s+#.*", "", line).strip() for line in lines]
    return [command for command in commands if command]


def python_of(page: Path) -> str:
    """Return the Python code of a page as one program."""
    blocks = re.findall(r"^```python\n(.*?)^```", page.read_text("utf-8"), re.DOTALL | re.MULTILINE)
    return "\n\n".join(blocks)


def main() -> int:
    """Run all commands; return 1 if one of them fails, otherwise 0."""
    failed = []
    with tempfile.TemporaryDirectory() as folder_name:
        folder = Path(folder_name)
        for program, page in PROGRAMS.items():
            (folder / program).write_text(python_of(PROJECT / page), "utf-8")
        pages_by_command = {command: page for page in PAGES for command in shown_commands(page)}
        for command, page in pages_by_command.items():
            label = f"{page.relative_to(PROJECT)}: {command}"
            reasons = [reason for pattern, reason in LEFT_OUT.items() if re.match(pattern, command)]
            if reasons:
                print(f"== left out: {label} ({reasons[0]})", flush=True)
            elif re.match(IN_PROJECT, command):
                failed += _run_command(label, command, PROJECT)
            elif re.match(IN_OWN_FOLDER, command):
                project = f"{shlex.quote(str(PROJECT))}/"
                command = command.replace("~/pw-elements/", project)
                command = re.sub(r"^(?=\.ci/)", project, command)
                failed += _run_command(label, command, folder)
            else:
                failed.append(f"{label}: neither run nor left out for a reason")
        for script in sorted(PROJECT.glob("examples/*_mesh.py")):
            shutil.copy(script, folder)
            command = f"{shlex.quote(str(PROJECT / 'run'))} python3 {script.name}"
            failed += _run_command(f"examples/{script.name}", command, folder)
    for line in failed:
        print(f"documented: {line}", file=sys.stderr)
    return int(bool(failed))


def _run_command(label: str, command: str, folder: Path) -> list[str]:
    print(f"== {label}", flush=True)
    settings = os.environ | {"PIP_DRY_RUN": "1"}  # do not install packages for the user
    process = subprocess.run(
        command, shell=True, cwd=folder, env=settings, capture_output=True, text=True, check=False
    )
    return (
        []
        if process.returncode == 0
        else [f"{label}: status {process.returncode}\n{process.stderr}"]
    )


if __name__ == "__main__":
    sys.exit(main())
