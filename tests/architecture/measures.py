"""Measures of the package: the size of its files, what they import, and facts that stand twice.

``python tests/architecture/measures.py`` prints them.
"""

from __future__ import annotations

import ast
import gc
import json
import re
import subprocess
import sys
import tomllib
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from repeated_defaults import configuration_files, repeated_defaults
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from sldvexp.config.paths import conf_dir

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "sldvexp"

#: What is imported inside functions because it need not be installed, and the extra that brings it.
OPTIONAL = {
    "cholespy": "cholesky",
    "cv2": "video",
    "dask": "dask",
    "distributed": "dask",
    "meshio": "mesh",
    "numba": "fast",
    "sdypy": "modal",
    "skfem": "fe",
    "sphinx": "docs",
}
#: Packages that bring a library of another name.
BROUGHT_BY = {"cv2": "opencv-python-headless", "sdypy": "sdypy-EMA", "skfem": "scikit-fem"}

#: First words of docstrings that say neither what is done nor what something is.
EMPTY_BEGINNINGS = ("What", "Whether", "Those", "The")

Function = ast.FunctionDef | ast.AsyncFunctionDef


@dataclass(frozen=True)
class Module:
    """One file of a package.

    Parameters
    ----------
    name : str
        Dotted; of an ``__init__.py`` that of its package.
    path : Path
    lines : int
    tree : ast.Module
    """

    name: str
    path: Path
    lines: int
    tree: ast.Module

    @property
    def package(self) -> str:
        """The dotted name that relative imports start from."""
        return self.name if self.path.stem == "__init__" else self.name.rpartition(".")[0]


Modules = Mapping[str, Module]


def statements(node: ast.AST) -> Iterator[ast.AST]:
    """Walk a node and the statements in it, which is a tenth of all that `ast.walk` finds."""
    yield node
    for name in ("body", "handlers", "orelse", "finalbody", "cases"):
        inner = getattr(node, name, None)
        for child in inner if isinstance(inner, list) else ():
            yield from statements(child)


def modules_of(package: Path) -> dict[str, Module]:
    """Read every module of the package in a folder, by its dotted name."""
    found = {}
    gc.disable()  # all of the millions of nodes stay
    for path in sorted(package.rglob("*.py")):
        parts = path.relative_to(package.parent).with_suffix("").parts
        name = ".".join(parts[:-1] if parts[-1] == "__init__" else parts)
        text = path.read_text(encoding="utf-8")
        found[name] = Module(name, path, len(text.splitlines()), ast.parse(text))
    gc.enable()
    return found


def loose_modules(modules: Modules) -> list[str]:
    """List the modules that stand in no room."""
    return [m.name for m in modules.values() if m.name.count(".") == 1 and m.package != m.name]


def imports(modules: Modules) -> Iterator[tuple[str, str]]:
    """List which module of a package imports which, also inside functions and for types alone.

    ``from package import name`` imports the module of that name if there is one, else the package.
    """
    for module in modules.values():
        named = {name for node in statements(module.tree) for name in _imported(node, module)}
        found = {name if name in modules else name.rpartition(".")[0] for name in named}
        yield from ((module.name, name) for name in sorted(found & modules.keys() - {module.name}))


def _imported(node: ast.AST, module: Module) -> Iterator[str]:
    """List the dotted names that a statement imports, if it is an import."""
    if isinstance(node, ast.Import):
        yield from (alias.name for alias in node.names)
    elif isinstance(node, ast.ImportFrom):
        parts = module.package.split(".")
        above = parts[: len(parts) - node.level + 1] if node.level else []
        base = ".".join([*above, *filter(None, [node.module])])
        yield from (f"{base}.{alias.name}" for alias in node.names)


def circles(modules: Modules) -> list[list[str]]:
    """List the largest sets of modules in which each leads to each other by imports."""
    number = {name: i for i, name in enumerate(modules)}
    edges = np.array([(number[a], number[b]) for a, b in imports(modules)]).reshape(-1, 2)
    size = (len(modules), len(modules))
    graph = coo_array((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), shape=size)
    members = defaultdict(list)
    labels = connected_components(graph.tocsr(), directed=True, connection="strong")[1]
    for name, label in zip(modules, labels, strict=True):
        members[label].append(name)
    return [names for names in members.values() if len(names) > 1]


def settings() -> dict[str, Any]:
    """Read ``pyproject.toml``."""
    return tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))


def contract(name: str) -> dict[str, Any]:
    """Read one of the contracts about imports."""
    [found] = [c for c in settings()["tool"]["importlinter"]["contracts"] if c["id"] == name]
    return dict(found)


def upward_imports(modules: Modules, layers: Sequence[str]) -> list[tuple[str, str]]:
    """List the imports of a room that stands above.

    Parameters
    ----------
    modules : mapping
    layers : sequence of str
        From the top down, as import-linter has them: ``a : b`` stand beside each other, ``(c)`` may
        not be there.
    """
    height = {room: -i for i, layer in enumerate(layers) for room in re.findall(r"\w+", layer)}

    def of(module: str) -> int | None:
        return height.get("".join(module.split(".")[1:2]))

    return [
        (a, b)
        for a, b in imports(modules)
        if (low := of(a)) is not None and (high := of(b)) is not None and low < high
    ]


def repeated_class_names(modules: Modules) -> dict[str, list[str]]:
    """List the modules of each class name that exists more than once."""
    found = defaultdict(list)
    for module in modules.values():
        for node in statements(module.tree):
            if isinstance(node, ast.ClassDef):
                found[node.name].append(module.name)
    return {name: where for name, where in found.items() if len(where) > 1}


def imports_inside_functions(modules: Modules) -> list[tuple[str, str]]:
    """List the import statements in functions: place and first name that each imports."""
    found = {}
    for module in modules.values():
        functions = [node for node in statements(module.tree) if isinstance(node, Function)]
        for node in (inner for function in functions for inner in statements(function)):
            for name in list(_imported(node, module))[:1]:
                found[f"{module.path.relative_to(PACKAGE.parent)}:{node.lineno}"] = name
    return list(found.items())


def is_optional(name: str) -> bool:
    """Tell whether a dotted name belongs to a package that need not be installed."""
    return name.partition(".")[0] in OPTIONAL


def type_checking_blocks(modules: Modules) -> list[str]:
    """List the modules with imports for types alone, once for each block of them."""
    return [
        module.name
        for module in modules.values()
        for node in statements(module.tree)
        if isinstance(node, ast.If) and ast.unparse(node.test).endswith("TYPE_CHECKING")
    ]


def docstrings(modules: Modules) -> list[str]:
    """List the docstrings of modules, classes and functions."""
    documented = ast.Module | ast.ClassDef | Function
    nodes = (n for m in modules.values() for n in statements(m.tree) if isinstance(n, documented))
    return [text for node in nodes if (text := ast.get_docstring(node))]


def begins_empty(docstring: str) -> bool:
    """Tell whether a docstring's first word is one of `EMPTY_BEGINNINGS`."""
    return re.split(r"\W", docstring, maxsplit=1)[0] in EMPTY_BEGINNINGS


#: A command with a misspelt key, whose answer is one sentence; prints the modules it has loaded.
MISTAKE = """
import json, sys
from sldvexp.cli.main import main
sys.argv = ["sldvexp", "experiment=pose", "pose.pathh=x"]
try:
    main()
finally:
    own = [module for name, module in sys.modules.items() if name.partition(".")[0] == "sldvexp"]
    print(json.dumps({module.__name__: module.__file__ for module in own}))
"""


def loaded_for_a_mistake() -> list[str]:
    """List the modules between a misspelt key on the command line and the sentence about it.

    All of the package that are loaded when the command ends count, but for an ``__init__.py`` with
    nothing but a docstring.
    """
    with TemporaryDirectory() as folder:
        command = [sys.executable, "-c", MISTAKE]
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    if done.returncode != 1 or "pose.pathh is not a known setting" not in done.stderr:
        raise RuntimeError(f"no sentence about the misspelt key: {done.stderr}")
    files = json.loads(done.stdout)
    return [name for name, file in files.items() if not _only_a_docstring(Path(file))]


def _only_a_docstring(file: Path) -> bool:
    body = ast.parse(file.read_text(encoding="utf-8")).body
    is_text = [isinstance(n, ast.Expr) and isinstance(n.value, ast.Constant) for n in body]
    return file.stem == "__init__" and all(is_text)


def table() -> Iterator[tuple[str, object]]:
    """Measure the package: names and values, and at the end what is behind some of them."""
    modules = modules_of(PACKAGE)
    longest = max(modules.values(), key=lambda module: module.lines)
    upward = upward_imports(modules, contract("one-way")["layers"])
    inside = imports_inside_functions(modules)
    told = docstrings(modules)
    empty = sum(map(begins_empty, told))
    files = configuration_files(conf_dir())
    yield "files", len(modules)
    yield "median lines of a file", median(module.lines for module in modules.values())
    yield "lines of the longest file", f"{longest.lines} ({longest.name})"
    yield "lines of all files", sum(module.lines for module in modules.values())
    yield "modules in no room", len(loose_modules(modules))
    yield "circles of imports", len(circles(modules))
    yield "rooms that import upward", len({importer.split(".")[1] for importer, _ in upward})
    yield "class names that exist twice", len(repeated_class_names(modules))
    yield "imports inside functions", len(inside)
    yield "  of optional extras", sum(is_optional(name) for _, name in inside)
    yield "blocks of imports for types", len(type_checking_blocks(modules))
    yield "defaults in YAML and dataclass", sum(len(repeated_defaults(file)) for file in files)
    yield "docstrings", len(told)
    yield f"  that begin with {', '.join(EMPTY_BEGINNINGS)}", f"{100 * empty / len(told):.1f} %"
    yield "files loaded for a misspelt key", len(loaded_for_a_mistake())
    yield from (("circle of imports", ", ".join(names)) for names in circles(modules))
    yield from (("upward import", " -> ".join(pair)) for pair in upward)
    for name, where in repeated_class_names(modules).items():
        yield f"class {name}", ", ".join(where)
    for place, name in inside:
        yield f"import in {place}", f"{name}{' (optional)' if is_optional(name) else ''}"


if __name__ == "__main__":
    for name, value in table():
        print(f"{name:56} {value}")
