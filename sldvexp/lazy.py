"""Heavy libraries, each imported when something of it is first used.

Modules import these names from here, at their top, as they would import the libraries themselves.
Composing a configuration, help and completion then load none of them, and a run only what it
needs: xarray, pandas and scipy.optimize take 0.3 to 0.5 s each.

Only top packages are given: a part of one (``scipy.sparse``) is reached through its package, since
asking for the part alone would import the package at once.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import lazy_loader

if TYPE_CHECKING:  # so that type checkers see the libraries' own types
    import h5py
    import jinja2
    import markupsafe
    import netCDF4
    import pandas
    import pint
    import pyvisa
    import scipy
    import xarray
else:
    jinja2 = lazy_loader.load("jinja2")
    h5py = lazy_loader.load("h5py")
    markupsafe = lazy_loader.load("markupsafe")
    netCDF4 = lazy_loader.load("netCDF4")
    pandas = lazy_loader.load("pandas")
    pint = lazy_loader.load("pint")
    pyvisa = lazy_loader.load("pyvisa")
    scipy = lazy_loader.load("scipy")
    xarray = lazy_loader.load("xarray")

__all__ = [
    "h5py",
    "jinja2",
    "markupsafe",
    "netCDF4",
    "pandas",
    "pint",
    "pyvisa",
    "scipy",
    "xarray",
]
