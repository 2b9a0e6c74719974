"""Import `pw_elements.files` without importing the solver.

`import pw_elements` imports DOLFINx, which is not needed to read results. The module `files`, which
uses the standard library only, is therefore loaded directly from its file, under its full name.
"""

import sys
from importlib.util import find_spec, module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType

_MODULE_NAME = "pw_elements.files"


def _load_files_module_without_solver() -> ModuleType:
    if _MODULE_NAME in sys.modules:
        return sys.modules[_MODULE_NAME]
    package = find_spec("pw_elements")
    assert package is not None
    assert package.submodule_search_locations is not None
    path = Path(package.submodule_search_locations[0], "files.py")
    spec = spec_from_file_location(_MODULE_NAME, path)
    assert spec is not None
    assert spec.loader is not None
    module = sys.modules[_MODULE_NAME] = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


_files = _load_files_module_without_solver()
ForeignFileOrFolder = _files.ForeignFileOrFolder
check_file_replaceable = _files.check_file_replaceable
create_or_claim_folder = _files.create_or_claim_folder
remove_file_if_present = _files.remove_file_if_present
replace_file_atomically = _files.replace_file_atomically
open_folder_replacement = _files.open_folder_replacement
remove_files_of_killed_processes = _files.remove_files_of_killed_processes
