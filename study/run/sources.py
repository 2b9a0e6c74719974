"""Source files of modules, found and read without importing them."""

import ast
import hashlib
from collections.abc import Iterator
from functools import cache
from importlib.util import find_spec
from pathlib import Path


def source(module: str) -> Path | None:
    """Return the source file of a module or package, or None if there is none."""
    top, *rest = module.split(".")
    spec = find_spec(top)  # of a top-level name: looks, but imports nothing
    if spec is None:
        return None
    if not rest:
        return Path(spec.origin) if spec.origin else None
    for folder in spec.submodule_search_locations or ():
        base = Path(folder, *rest)
        for path in (base.with_name(f"{base.name}.py"), base / "__init__.py"):
            if path.is_file():
                return path
    return None


def package_sources(package: str) -> list[Path]:
    """Return all source files of a top-level package, sorted."""
    spec = find_spec(package)
    folders = (spec.submodule_search_locations if spec else None) or ()
    return sorted(path for folder in folders for path in Path(folder).rglob("*.py"))


def imported(module: str) -> frozenset[str]:
    """Return the names of all modules that a module's source imports, anywhere in it.

    `from a import b` counts as `a` and `a.b`: without importing, b may be either a module or not.
    """
    path = source(module)
    if path is None:
        return frozenset()
    package = module if path.name == "__init__.py" else module.rpartition(".")[0]
    return _names(path.read_text(encoding="utf-8"), package)


def closure(module: str, without: frozenset[str] = frozenset()) -> dict[str, Path]:
    """Return the sources of a module and, transitively, of what it imports of its own package.

    Args:
        module: Full name of the module.
        without: Modules not to enter.
    """
    top = module.split(".")[0]
    found: dict[str, Path] = {}
    waiting, seen = [module], set(without)
    while waiting:
        name = waiting.pop()
        if name in seen or name.split(".")[0] != top:
            continue
        seen.add(name)
        path = source(name)
        if path is not None:
            found[name] = path
            waiting += sorted(imported(name))
            waiting.append(name.rpartition(".")[0] or name)  # the package around it runs first
    return dict(sorted(found.items()))


def code_digest(path: Path) -> str:
    """Return a digest of a source's code: without comments, docstrings and layout."""
    return _code_digest(path.read_bytes())


@cache
def _code_digest(source: bytes) -> str:
    return hashlib.sha256(repr(_said(ast.parse(source))).encode()).hexdigest()


def _said(node: object) -> object:
    """Return a tree without places and texts; compiled code would keep the lines of classes."""
    if isinstance(node, list):
        return [_said(one) for one in node if not _is_text(one)]
    if not isinstance(node, ast.AST):
        return node
    return [type(node).__name__, *[_said(getattr(node, name, None)) for name in node._fields]]


def _is_text(node: object) -> bool:
    """Whether this is a text as a statement: a docstring, or the like of an attribute."""
    return (
        isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
    )


@cache
def _names(text: str, package: str) -> frozenset[str]:
    return frozenset(_named(ast.parse(text), package))


def _named(tree: ast.AST, package: str) -> Iterator[str]:
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield alias.name
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                around = package.split(".")
                above = around[: len(around) - node.level + 1]
                base = ".".join([*above, base] if base else above)
            yield base
            for alias in node.names:
                yield f"{base}.{alias.name}"
