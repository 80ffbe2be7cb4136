"""Heavy libraries, each imported when something of it is first used.

Modules import these names from here, at their top, as they would import the libraries themselves.
Composing a configuration, help and completion then load none of them, and a run only what it
needs: xarray, pandas and scipy.optimize take 0.3 to 0.5 s each.

Only top packages are given: a part of one (``scipy.sparse``) is reached through its package, since
asking for the part alone would import the package at once.
"""

from __future__ import annotations

import functools
import importlib
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec, PathFinder
from types import ModuleType
from typing import TYPE_CHECKING, Any

import lazy_loader

if TYPE_CHECKING:  # so that type checkers see the libraries' own types
    import h5py
    import jinja2
    import markupsafe
    import netCDF4
    import numpy
    import pandas
    import pyvisa
    import scipy
    import xarray
else:
    jinja2 = lazy_loader.load("jinja2")
    h5py = lazy_loader.load("h5py")
    markupsafe = lazy_loader.load("markupsafe")
    netCDF4 = lazy_loader.load("netCDF4")
    numpy = lazy_loader.load("numpy")
    pandas = lazy_loader.load("pandas")
    pyvisa = lazy_loader.load("pyvisa")
    scipy = lazy_loader.load("scipy")
    xarray = lazy_loader.load("xarray")


@contextmanager
def _hidden(*names: str) -> Iterator[None]:
    """Let an import of some packages fail."""
    were = {name: sys.modules.pop(name) for name in names if name in sys.modules}
    sys.modules.update(dict.fromkeys(names))  # type: ignore[arg-type]
    try:
        yield
    finally:
        for name in names:
            del sys.modules[name]
        sys.modules.update(were)


def _without_compiler() -> None:
    """Keep scipy from loading a compiler of Fortran, which takes 0.1 s.

    scipy copies all that numpy has, the compiler among it. It is there for whoever asks for it
    later.
    """
    name = "numpy.f2py"
    if name not in sys.modules:
        numpy.f2py = sys.modules[name] = ModuleType(name)
        try:
            with suppress(ImportError):
                importlib.import_module("scipy._lib.array_api_compat.numpy")
        finally:
            del numpy.f2py, sys.modules[name]


def numpy_alone(to_the_end: bool = False) -> None:
    """Keep xarray in this process from loading what else arrays could be of, which takes 0.3 s.

    It asks for dask and pint as soon as it looks at an array, and remembers what it found. A
    command that only reads a dataset has arrays of numpy alone; where dask is in use, nothing is
    changed. Nor does scipy load numpy's compiler.

    Parameters
    ----------
    to_the_end : bool
        Dask is not there for this process any more: xarray looks for its locks when it writes a
        file, and pint, where it is installed, for its arrays: 0.5 s more.
    """
    if "dask" not in sys.modules:
        # Where xarray knows already that dask is installed, it is loaded after all.
        new = "xarray.core" not in sys.modules
        with _hidden("dask", "pint"), suppress(ImportError):
            assert xarray.Variable("place", [0.0]).astype(float).to_numpy() is not None
        _without_compiler()
        if to_the_end and new:
            sys.modules["dask"] = None  # type: ignore[assignment]


def _without_capabilities(module: Any) -> None:
    """Let scipy's decorator, which adds a note to a docstring, parse an empty one."""
    parser = functools.partial(module.FunctionDoc, doc="")
    assert str(parser(numpy_alone)), "another parser than the one known here"
    module.FunctionDoc = parser


def _without_properties(module: Any) -> None:
    """Let matplotlib list no properties in the docstrings of its artists."""
    module.kwdoc = lambda artist: ""


#: Modules that put docstrings together as others are imported, and what keeps each from it.
OF_DOCSTRINGS: dict[str, Callable[[Any], None]] = {
    "scipy._lib._array_api": _without_capabilities,
    "matplotlib.artist": _without_properties,
}


class _WithoutDocstrings(MetaPathFinder):
    """Finder of the modules that put docstrings together, which are kept from it once loaded."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Find one of these modules; others are left to other finders."""
        found = PathFinder.find_spec(fullname, path) if fullname in OF_DOCSTRINGS else None
        if found is not None and found.loader is not None:
            execute = found.loader.exec_module

            def executed(module: ModuleType) -> None:
                execute(module)
                with suppress(Exception):  # of another release, which takes its time
                    OF_DOCSTRINGS[fullname](module)

            found.loader.exec_module = executed  # type: ignore[method-assign]
        return found


def without_docstrings() -> None:
    """Keep libraries in this process from putting docstrings together, which takes 0.3 s.

    scipy parses and formats those of its functions and matplotlib lists an artist's properties, as
    they are imported. A command shows none of them.
    """
    if not any(isinstance(finder, _WithoutDocstrings) for finder in sys.meta_path):
        sys.meta_path.insert(0, _WithoutDocstrings())


__all__ = [
    "h5py",
    "jinja2",
    "markupsafe",
    "netCDF4",
    "numpy_alone",
    "pandas",
    "pyvisa",
    "scipy",
    "without_docstrings",
    "xarray",
]
