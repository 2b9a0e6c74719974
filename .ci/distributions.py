"""Check the contents of a built sdist and wheel, and list them with their sizes, for `.ci/build`.

`python3 .ci/distributions.py FOLDER` compares them with the files that Git tracks: the sdist has
all of them, the wheel those of the library, and neither contains results, caches or paths of the
machine on which it was built. The script needs only Python.
"""

import subprocess
import sys
import tarfile
import zipfile
from collections.abc import Iterable
from pathlib import Path

PROJECT = Path(__file__).resolve().parents[1]
LIBRARY = "pw_elements/"


def read_sdist(path: Path) -> dict[str, bytes]:
    """Return the contents of the files of an sdist, by their names within its top folder."""
    with tarfile.open(path) as archive:
        files = {m.name: archive.extractfile(m) for m in archive.getmembers() if not m.isdir()}
        contents = {name: file.read() if file else b"" for name, file in files.items()}
    top_folder = path.name.removesuffix(".tar.gz") + "/"
    return {name.removeprefix(top_folder): content for name, content in contents.items()}


def read_wheel(path: Path) -> dict[str, bytes]:
    """Return the contents of the files of a wheel, by their names."""
    with zipfile.ZipFile(path) as archive:
        return {name: archive.read(name) for name in archive.namelist() if name[-1] != "/"}


def is_generated(name: str) -> bool:
    """Return whether a file of an sdist or wheel is written by the build itself."""
    return name in ("PKG-INFO", "setup.cfg") or name.split("/")[0].endswith(
        (".egg-info", ".dist-info")
    )


def find_faults(
    label: str, contents: dict[str, bytes], expected: set[str], local_paths: Iterable[str]
) -> list[str]:
    """Return a line for each file that is missing, unexpected or names a path of this machine."""
    names = {name for name in contents if not is_generated(name)}
    faults = [f"{label} lacks {name}" for name in sorted(expected - names)]
    faults += [
        f"{label} contains {name}, which Git does not track" for name in sorted(names - expected)
    ]
    faults += [
        f"{label}: {name} contains the path {local_path}"
        for name, content in sorted(contents.items())
        for local_path in local_paths
        if local_path.encode() in content
    ]
    return faults


def main(folder: Path) -> int:
    """Print sizes and faults; return 1 if there are faults, otherwise 0."""
    command = ["git", "-C", str(PROJECT), "ls-files", "-z"]
    listing = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    tracked = set(listing.rstrip("\0").split("\0"))
    (sdist,) = folder.glob("*.tar.gz")
    (wheel,) = folder.glob("*.whl")
    parts = [
        (sdist, read_sdist(sdist), tracked),
        (wheel, read_wheel(wheel), {name for name in tracked if name.startswith(LIBRARY)}),
    ]
    faults = []
    for path, contents, expected in parts:
        size, unpacked = path.stat().st_size, sum(map(len, contents.values()))
        print(
            f"== {path.name}: {size / 1e6:.2f} MB, {len(contents)} files of {unpacked / 1e6:.2f} MB"
        )
        faults += find_faults(path.name, contents, expected, [f"{PROJECT}/", f"{folder}/"])
    for line in faults:
        print(f"distributions: {line}", file=sys.stderr)
    return int(bool(faults))


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]).resolve()))
