"""Measures for the claims: functions that compute one number from the stored results.

All public functions of the modules in this folder are measures.
"""

import inspect
import pkgutil
from collections.abc import Callable
from functools import cache
from importlib import import_module
from typing import Any


@cache
def _collect_measures_by_name() -> dict[str, Callable[..., Any]]:
    modules = [
        import_module(module_info.name)
        for module_info in pkgutil.iter_modules(__path__, f"{__name__}.")
    ]
    return {
        name: function
        for module in modules
        for name, function in inspect.getmembers(module, inspect.isfunction)
        if function.__module__ == module.__name__
    }


def __getattr__(name: str) -> Callable[..., Any]:
    if name.startswith("_") or name not in _collect_measures_by_name():
        raise AttributeError(f"{__name__} has no measure {name!r}")
    return _collect_measures_by_name()[name]
