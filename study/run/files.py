"""The library's module of files, for modules of the study that must not import the solver.

`import pw_elements` imports DOLFINx, which reading a result does not need. So the module, which
imports the standard library alone, is loaded by its place, under its own name.
"""

import sys
from importlib.util import find_spec, module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType

_NAME = "pw_elements.files"


def _load() -> ModuleType:
    if _NAME in sys.modules:
        return sys.modules[_NAME]
    package = find_spec("pw_elements")
    assert package is not None
    assert package.submodule_search_locations is not None
    path = Path(package.submodule_search_locations[0], "files.py")
    spec = spec_from_file_location(_NAME, path)
    assert spec is not None
    assert spec.loader is not None
    module = sys.modules[_NAME] = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


_files = _load()
ForeignEntry = _files.ForeignEntry
check_file_replaceable = _files.check_file_replaceable
claim_folder = _files.claim_folder
remove_file = _files.remove_file
replace_file = _files.replace_file
replacing_folder = _files.replacing_folder
remove_unfinished = _files.remove_unfinished
