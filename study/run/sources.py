"""Find source files of modules, and compute digests of the code, without importing the modules."""

import ast
import hashlib
from collections.abc import Iterator
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

from study.run.pages import SECTION_LINE


def find_source_file(module: str) -> Path | None:
    """Return the source file of a module or package, or None if there is none."""
    top, *rest = module.split(".")
    spec = find_spec(top)  # imports nothing, as the name is a top-level one
    if spec is None:
        return None
    if not rest:
        return Path(spec.origin) if spec.origin and spec.has_location else None  # None: built in
    for folder in spec.submodule_search_locations or ():
        base = Path(folder, *rest)
        for path in (base.with_name(f"{base.name}.py"), base / "__init__.py"):
            if path.is_file():
                return path
    return None


def list_package_sources(package: str) -> list[Path]:
    """Return all source files of a top-level package, sorted."""
    spec = find_spec(package)
    folders = (spec.submodule_search_locations if spec else None) or ()
    return sorted(path for folder in folders for path in Path(folder).rglob("*.py"))


def list_imported_modules(module: str) -> frozenset[str]:
    """Return the names of all modules that a module imports, including imports within functions.

    `from a import b` gives `a` and `a.b`, because `b` may be a module.
    """
    path = find_source_file(module)
    if path is None:
        return frozenset()
    package = module if path.name == "__init__.py" else module.rpartition(".")[0]
    return _parse_imported_names(path.read_text(encoding="utf-8"), package)


def collect_imported_sources(
    *modules: str, excluded_modules: frozenset[str] = frozenset()
) -> dict[str, Path]:
    """Return the source files of modules and of all that they import from the same packages.

    Args:
        modules: Full names of the modules.
        excluded_modules: Names of modules to leave out, together with their imports.

    Returns:
        Source files by name of module, sorted.
    """
    tops = {module.split(".")[0] for module in modules}
    sources: dict[str, Path] = {}
    queue, visited = [*modules], set(excluded_modules)
    while queue:
        name = queue.pop()
        if name in visited or name.split(".")[0] not in tops:
            continue
        visited.add(name)
        path = find_source_file(name)
        if path is not None:
            sources[name] = path
            queue += sorted(list_imported_modules(name))
            queue.append(name.rpartition(".")[0] or name)  # its package is imported with it
    return dict(sorted(sources.items()))


def digest_code_used_by_definition(
    module: str, definition: str, excluded_modules: frozenset[str] = frozenset()
) -> dict[str, str]:
    """Return digests of all code that a definition in a module uses, directly or indirectly.

    Of the module itself, and of pages of the study from which it imports, only the statements that
    define used names count. Other imported modules of the same top-level package count in full.

    Args:
        module: Full name of the module.
        definition: Name of the function, class or constant.
        excluded_modules: Names of modules to leave out.

    Returns:
        Digests by name of module.
    """
    path = find_source_file(module)
    if path is None:
        return {}
    statements = _statements_used_by_definition(path.read_bytes(), definition)
    digest = hashlib.sha256(
        "".join(statement.code for statement in statements).encode()
    ).hexdigest()
    digests = {module: digest}
    package = module if path.name == "__init__.py" else module.rpartition(".")[0]
    top = f"{module.partition('.')[0]}."
    imported_names: set[str] = set()
    for node in (statement.node for statement in statements):
        origin = node.module or "" if isinstance(node, ast.ImportFrom) else ""
        if isinstance(node, ast.ImportFrom) and origin.startswith(top) and _is_section_page(origin):
            for alias in node.names:
                lent = digest_code_used_by_definition(
                    origin, alias.name, excluded_modules | {module}
                )
                digests |= {f"{lender}:{alias.name}": value for lender, value in lent.items()}
        elif isinstance(node, ast.Import | ast.ImportFrom):
            imported_names |= set(_iterate_imported_names(node, package))
    names_in_package = sorted(
        definition for definition in imported_names if f"{definition}.".startswith(top)
    )
    sources = collect_imported_sources(
        *names_in_package, excluded_modules=excluded_modules | {module}
    )
    return digests | {
        other: digest_code_without_docstrings(file) for other, file in sources.items()
    }


def _is_section_page(module: str) -> bool:
    path = find_source_file(module)
    return path is not None and SECTION_LINE.search(path.read_text(encoding="utf-8")) is not None


class _Statement(NamedTuple):
    """Statement at the top level of a module.

    Attributes:
        node: Syntax tree of the statement.
        code: Text that represents the statement without comments, docstrings and layout.
        bound: Names that the statement defines or whose objects it changes.
        used: Names that the statement reads.
    """

    node: ast.stmt
    code: str
    bound: set[str]
    used: set[str]


def _statements_used_by_definition(source: bytes, definition: str) -> list[_Statement]:
    """Return the top-level statements that a definition uses, directly or indirectly.

    Args:
        source: Source code of the module.
        definition: Name of the function, class or constant.
    """
    remaining = _parse_statements(source)
    names, reached = {definition}, []
    while binding := [item for item in remaining if not item.bound.isdisjoint(names)]:
        reached += binding
        names.update(*(item.used for item in binding))
        remaining = [item for item in remaining if item not in binding]
    return [item for item in _parse_statements(source) if item in reached]


@cache
def _parse_statements(source: bytes) -> list[_Statement]:
    return [
        _Statement(
            node,
            repr(_nest_syntax_tree_without_docstrings(node)),
            _list_bound_and_changed_names(node),
            {
                part.id
                for part in ast.walk(node)
                if isinstance(part, ast.Name) and isinstance(part.ctx, ast.Load)
            },
        )
        for node in ast.parse(source).body
        if not _is_docstring(node)
    ]


def _list_bound_and_changed_names(statement: ast.stmt) -> set[str]:
    """Return the names that a statement defines, and the names of objects that it changes.

    An object is changed by assigning an item or attribute, or by a call such as
    `CASES.append(...)`. Variables of comprehensions do not count, because they are local to the
    comprehension.
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
            names.add(_name_at_root_of_expression(node))
    if isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Call):
        names.add(_name_at_root_of_expression(statement.value.func))
    return names


def _name_at_root_of_expression(node: ast.expr) -> str:
    while isinstance(node, ast.Attribute | ast.Subscript | ast.Call):
        node = node.func if isinstance(node, ast.Call) else node.value
    return node.id if isinstance(node, ast.Name) else ""


def digest_code_without_docstrings(path: Path) -> str:
    """Return a digest of the code in a source file that ignores comments, docstrings and layout."""
    return _digest_source_without_docstrings(path.read_bytes())


@cache
def _digest_source_without_docstrings(source: bytes) -> str:
    return hashlib.sha256(
        repr(_nest_syntax_tree_without_docstrings(ast.parse(source))).encode()
    ).hexdigest()


def _nest_syntax_tree_without_docstrings(node: object) -> object:
    """Return a syntax tree as nested lists, without line numbers and docstrings.

    Bytecode would not do, because it contains the line numbers of classes.
    """
    if isinstance(node, list):
        return [
            _nest_syntax_tree_without_docstrings(item) for item in node if not _is_docstring(item)
        ]
    if not isinstance(node, ast.AST):
        return node
    return [
        type(node).__name__,
        *[_nest_syntax_tree_without_docstrings(getattr(node, name, None)) for name in node._fields],
    ]


def _is_docstring(node: object) -> bool:
    """Return whether a node is the docstring of a definition or attribute."""
    return (
        isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
    )


@cache
def _parse_imported_names(text: str, package: str) -> frozenset[str]:
    return frozenset(_iterate_imported_names(ast.parse(text), package))


def _iterate_imported_names(tree: ast.AST, package: str) -> Iterator[str]:
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield alias.name
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                parts = package.split(".")
                parents = parts[: len(parts) - node.level + 1]
                base = ".".join([*parents, base] if base else parents)
            yield base
            for alias in node.names:
                yield f"{base}.{alias.name}"
