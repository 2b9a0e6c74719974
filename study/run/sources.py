"""Source files of modules, found and read without importing them."""

import ast
import hashlib
from collections.abc import Iterator
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

from study.run.pages import SECTION_LINE


def source(module: str) -> Path | None:
    """Return the source file of a module or package, or None if there is none."""
    top, *rest = module.split(".")
    spec = find_spec(top)  # of a top-level name: looks, but imports nothing
    if spec is None:
        return None
    if not rest:
        return Path(spec.origin) if spec.origin and spec.has_location else None  # or built in
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


def closure(*modules: str, without: frozenset[str] = frozenset()) -> dict[str, Path]:
    """Return the sources of modules and, transitively, of what they import of their packages.

    Args:
        modules: full names of the modules.
        without: modules not to enter.
    """
    tops = {module.split(".")[0] for module in modules}
    found: dict[str, Path] = {}
    waiting, seen = [*modules], set(without)
    while waiting:
        name = waiting.pop()
        if name in seen or name.split(".")[0] not in tops:
            continue
        seen.add(name)
        path = source(name)
        if path is not None:
            found[name] = path
            waiting += sorted(imported(name))
            waiting.append(name.rpartition(".")[0] or name)  # the package around it runs first
    return dict(sorted(found.items()))


def reached_sources(
    module: str, name: str, without: frozenset[str] = frozenset()
) -> dict[str, str]:
    """Return digests of the code that a definition of a module leads to.

    Of the module itself, and of pages of sections from which it takes definitions, only statements
    count that bind a name which the definition, or what it leads to, uses; of other modules that
    these import from the same package, all code.

    Args:
        module: full name of the module.
        name: name of the definition.
        without: modules not to enter.

    Returns:
        digests by the names of modules.
    """
    path = source(module)
    if path is None:
        return {}
    statements = _reached_statements(path.read_bytes(), name)
    digest = hashlib.sha256("".join(one.code for one in statements).encode()).hexdigest()
    digests = {module: digest}
    package = module if path.name == "__init__.py" else module.rpartition(".")[0]
    top = f"{module.partition('.')[0]}."
    starts: set[str] = set()
    for node in (one.node for one in statements):
        named = node.module or "" if isinstance(node, ast.ImportFrom) else ""
        if isinstance(node, ast.ImportFrom) and named.startswith(top) and _is_page(named):
            for alias in node.names:
                part = reached_sources(named, alias.name, without | {module})
                digests |= {f"{one}:{alias.name}": value for one, value in part.items()}
        elif isinstance(node, ast.Import | ast.ImportFrom):
            starts |= set(_named(node, package))
    own = sorted(name for name in starts if f"{name}.".startswith(top))
    found = closure(*own, without=without | {module})
    return digests | {other: code_digest(file) for other, file in found.items()}


def _is_page(module: str) -> bool:
    path = source(module)
    return path is not None and SECTION_LINE.search(path.read_text(encoding="utf-8")) is not None


class _Statement(NamedTuple):
    """A statement of a module: its code, and the names that it binds or changes, and uses."""

    node: ast.stmt
    code: str
    bound: set[str]
    used: set[str]


def _reached_statements(source: bytes, name: str) -> list[_Statement]:
    """Return the statements of a module that a name leads to, in their order."""
    waiting = _statements(source)
    names, reached = {name}, []
    while more := [one for one in waiting if not one.bound.isdisjoint(names)]:
        reached += more
        names.update(*(one.used for one in more))
        waiting = [one for one in waiting if one not in more]
    return [one for one in _statements(source) if one in reached]


@cache
def _statements(source: bytes) -> list[_Statement]:
    return [
        _Statement(
            node,
            repr(_said(node)),
            _bound_or_changed(node),
            {
                part.id
                for part in ast.walk(node)
                if isinstance(part, ast.Name) and isinstance(part.ctx, ast.Load)
            },
        )
        for node in ast.parse(source).body
        if not _is_text(node)
    ]


def _bound_or_changed(statement: ast.stmt) -> set[str]:
    """Return the names that a statement binds, or whose objects it changes by item or attribute.

    Variables of comprehensions are bound within these only.
    """
    if isinstance(statement, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
        return {statement.name}
    nodes = list(ast.walk(statement))
    loops = [node.target for node in nodes if isinstance(node, ast.comprehension)]
    loop_variables = {
        node for target in loops for node in ast.walk(target) if isinstance(node, ast.Name)
    }
    names: set[str] = set()
    for node in nodes:
        if node in loop_variables:
            continue
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            names.add(node.name)
        elif isinstance(node, ast.Import | ast.ImportFrom):
            names |= {(alias.asname or alias.name).partition(".")[0] for alias in node.names}
        elif isinstance(node, ast.Name) and not isinstance(node.ctx, ast.Load):
            names.add(node.id)
        elif isinstance(node, ast.Attribute | ast.Subscript) and not isinstance(node.ctx, ast.Load):
            names.add(_base_name(node))
    if isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Call):
        names.add(_base_name(statement.value.func))
    return names


def _base_name(node: ast.expr) -> str:
    while isinstance(node, ast.Attribute | ast.Subscript | ast.Call):
        node = node.func if isinstance(node, ast.Call) else node.value
    return node.id if isinstance(node, ast.Name) else ""


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
