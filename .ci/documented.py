"""Run the commands that README and docs show in `sh` blocks, on stored results of the study.

`python3 .ci/documented.py` runs each line that starts ./run or ~/pw-elements/run, and the scripts
of `examples` that make meshes, which neither tests nor gallery run. What is left out is told with
its reason. Needs Python alone.
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

LEFT_OUT = {
    r"\./run study$": "a step of its own",
    r"\./run site$": "a step of its own",
    r"\./run test\b": "a step of its own",
    r"\.ci/run\b": "this is it",
    r"cd\b": "each command below runs in such a folder",
    r"(sudo apt|python3 -m venv|~/pw/bin/pip)\b": "changes the system: see .ci/package",
    r"(conda|docker|pip)\b": "needs another system",
    r"pre-commit\b": "changes the checkout's hooks",
}

# Programs that the pages show commands for, by the page whose code they are
PROGRAMS = {"plate.py": "README.md", "punch.py": "docs/how-to/parallel.md"}


def shown_commands(page: Path) -> list[str]:
    """Return the commands of a page's sh blocks, without comments; lines joined where broken."""
    blocks = re.findall(r"^```sh\n(.*?)^```", page.read_text("utf-8"), re.DOTALL | re.MULTILINE)
    lines = "".join(blocks).replace("\\\n", " ").splitlines()
    commands = [re.sub(r"\s+#.*", "", line).strip() for line in lines]
    return [command for command in commands if command]


def python_of(page: Path) -> str:
    """Return the Python code of a page as one program."""
    blocks = re.findall(r"^```python\n(.*?)^```", page.read_text("utf-8"), re.DOTALL | re.MULTILINE)
    return "\n\n".join(blocks)


def main() -> int:
    """Run all; return 1 if a command failed."""
    failed = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for program, page in PROGRAMS.items():
            (folder / program).write_text(python_of(PROJECT / page), "utf-8")
        todo = {command: page for page in PAGES for command in shown_commands(page)}
        for command, page in todo.items():
            told = f"{page.relative_to(PROJECT)}: {command}"
            reasons = [why for like, why in LEFT_OUT.items() if re.match(like, command)]
            if reasons:
                print(f"== left out: {told} ({reasons[0]})", flush=True)
            elif re.match(r"(\./|~/pw-elements/)run ", command):
                of_the_project = command.startswith("./")
                command = re.sub(r"^\S+run", shlex.quote(str(PROJECT / "run")), command)
                failed += _run(told, command, PROJECT if of_the_project else folder)
            else:
                failed.append(f"{told}: neither run nor left out for a reason")
        for script in sorted(PROJECT.glob("examples/*_mesh.py")):
            shutil.copy(script, folder)
            command = f"{shlex.quote(str(PROJECT / 'run'))} python3 {script.name}"
            failed += _run(f"examples/{script.name}", command, folder)
    for line in failed:
        print(f"documented: {line}", file=sys.stderr)
    return int(bool(failed))


def _run(told: str, command: str, folder: Path) -> list[str]:
    print(f"== {told}", flush=True)
    settings = os.environ | {"PIP_DRY_RUN": "1"}  # nothing is added to the user's own packages
    done = subprocess.run(
        command, shell=True, cwd=folder, env=settings, capture_output=True, text=True, check=False
    )
    return [] if done.returncode == 0 else [f"{told}: status {done.returncode}\n{done.stderr}"]


if __name__ == "__main__":
    sys.exit(main())
