"""What a figure chooses from a run, and the sentence if it is not there.

One of several views or fields by name, one frequency, the recorded settings, and plugins made of
them for what a figure computes anew. Every complaint begins with ``plot:`` and the figure's name.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from omegaconf import OmegaConf
from omegaconf.errors import OmegaConfBaseException

from sldvexp.config import registry
from sldvexp.config.refusals import refusal
from sldvexp.dataset import FREQUENCY, RunData
from sldvexp.errors import UserError, nearest
from sldvexp.lazy import xarray as xr

#: Relative difference of a frequency from one that was asked for, up to which it is that one.
SAME = 1e-4


def require(figure: str, missing: str) -> None:
    """Refuse a figure whose data is missing, in a sentence that is empty if nothing is."""
    if missing:
        raise UserError(f"plot: {figure}: {missing}")


def one_of(name: str | None, valid: Iterable[str], figure: str, kind: str) -> str:
    """Choose the one that was asked for, or the first.

    Raises
    ------
    UserError
        If there is none of that name.
    """
    valid = list(valid)
    if name is None:
        return valid[0]
    if str(name) not in valid:
        raise UserError(f"plot: {figure}: there is no {kind} {name}; {nearest(str(name), valid)}")
    return str(name)


def at_frequency(
    group: xr.Dataset, figure: str, frequency: float | None = None, of: str = "velocity"
) -> tuple[xr.Dataset, str]:
    """Choose one frequency of a group.

    Parameters
    ----------
    group : Dataset
    figure : str
        For messages.
    frequency : float, Hz, optional
        The nearest that there is, which the text then says; without it the one of the largest
        r.m.s. value.
    of : str
        Variable whose value that is.

    Returns
    -------
    group : Dataset
        Without the dimension.
    text : str
        ``197 Hz``, or empty if the run does not tell a frequency.

    Raises
    ------
    UserError
        If the frequency is not within those of the run.
    """
    if "frequency" not in group.dims:
        return group, ""
    hertz, unit = group["frequency"].values, FREQUENCY.units
    asked = ""
    if frequency is None:
        others = [d for d in group[of].dims if d != "frequency"]
        index = int(np.argmax(np.nan_to_num((abs(group[of]) ** 2).mean(others).values)))
    elif not hertz.min() <= frequency <= hertz.max():
        raise UserError(
            f"plot: {figure}: the frequencies go from {hertz.min():g} to {hertz.max():g} {unit}; "
            f"{frequency:g} {unit} is none of them"
        )
    else:
        index = int(np.abs(hertz - frequency).argmin())
        if not np.isclose(hertz[index], frequency, rtol=SAME, atol=0.0):
            asked = f", the nearest to {frequency:g} {unit}"
    return group.isel(frequency=index), f"{hertz[index]:g} {unit}{asked}"


def settings(run: RunData, figure: str) -> dict[str, Any]:
    """Read the configuration that the run's file records.

    Raises
    ------
    UserError
        If there is none, or it refers to something else: a run's file has values only.
    """
    if "config" not in run.attributes:
        raise UserError(f"plot: {figure}: needs the run's configuration; give an opened run.nc")
    if "${" in str(run.attributes["config"]):
        raise UserError(f"plot: {figure}: the run's configuration refers to something; it must not")
    return run.config


def plugin(run: RunData, group: str, figure: str) -> Any:
    """Make the plugin of one group with its settings; only registered ones can be named.

    Raises
    ------
    UserError
        If the run had none, or its settings are none of this version's.
    """
    names = run.plugins if "plugins" in run.attributes else {}
    if group not in names:
        raise UserError(f"plot: {figure}: the run has no {group}")
    recorded = settings(run, figure).get(group)
    if not isinstance(recorded, dict):
        raise UserError(f"plot: {figure}: the run's configuration has no table {group}")
    schema = registry.schema_of(registry.get(group, names[group]))
    try:
        return OmegaConf.to_object(OmegaConf.merge(schema, recorded))
    except OmegaConfBaseException as error:
        where = f"{group}.{error.full_key}" if error.full_key else group
        raise UserError(f"plot: {figure}: the run's {where} {refusal(error)}") from None
