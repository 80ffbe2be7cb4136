"""Units in attributes of netCDF variables, compared with those in their names and settings.

The attribute is the file's own word: what a name or a setting says of the same array must agree.
"""

from __future__ import annotations

from pathlib import Path

from sldvexp.dataset import FREQUENCY
from sldvexp.errors import UserError
from sldvexp.io.questions import OpenQuestionError
from sldvexp.io.velocities.headings import SAME, HeadingUnits, of_quantity
from sldvexp.io.velocities.table import (
    UNSTATED_FREQUENCY,
    UNSTATED_LENGTH,
    UNSTATED_VELOCITY,
    FileLayout,
)
from sldvexp.lazy import xarray as xr
from sldvexp.unit_labels import Amplitude, UnitLabel, UnitNotUnderstoodError, read_unit
from sldvexp.units import LengthUnit, VelocityUnit, unit_named


def velocity_units(
    velocity: xr.DataArray,
    unit: VelocityUnit | None,
    named: HeadingUnits,
    layout: FileLayout,
    path: Path,
) -> tuple[float, Amplitude | None]:
    """Find one of the velocities' unit in m/s and their measure: by attribute, name or settings.

    Raises
    ------
    UserError
        If the attribute contradicts one of the others, or is not understood and no setting
        replaces it.
    """
    text = str(velocity.attrs.get("units", ""))
    stated = _stated_velocity(text, unit, layout, path) if text else None
    if stated is None:
        return named.velocity or UNSTATED_VELOCITY.value, named.amplitude
    said = f"{path}: the file states velocities in {text}, the configuration instrument."
    if unit and abs(stated.factor / unit.value - 1) > SAME:
        raise UserError(f"{said}unit={unit.name}; they must agree")
    measure = stated.amplitude
    if measure and layout.amplitude not in (None, measure):
        raise UserError(f"{said}amplitude={layout.amplitude.name}; they must agree")
    require_agreement(stated.factor, named.velocity, path)
    if measure and named.amplitude not in (None, measure):
        raise _contradiction(path)
    return stated.factor, measure or named.amplitude


def _stated_velocity(
    text: str, unit: VelocityUnit | None, layout: FileLayout, path: Path
) -> UnitLabel | None:
    """Understand an attribute; None if it is not understood but the settings say it."""
    if (plain := text.strip().replace("/", "_per_")) in VelocityUnit.__members__:
        return UnitLabel(text, "velocity", VelocityUnit[plain].value)
    try:
        return of_quantity(read_unit(text.replace("_per_", "/")), "velocity")
    except UnitNotUnderstoodError as error:
        if unit and layout.amplitude:
            return None
        remedy = "say it with both instrument.unit and instrument.amplitude"
        message = f"{path}, velocity: {error}; {remedy}, or correct its attribute units"
        raise OpenQuestionError(message) from None
    except UserError as error:
        raise UserError(f"{path}, velocity: {error}; correct its attribute units") from None


def length_factor(
    places: xr.DataArray, unit: LengthUnit | None, named: float | None, path: Path
) -> float:
    """Find one of the positions' unit in m: by their attribute, name, or the settings.

    Raises
    ------
    UserError
        If the attribute contradicts one of the others.
    """
    text = str(places.attrs.get("units", ""))
    if not text:
        return named or (unit or UNSTATED_LENGTH).value
    stated = unit_named(LengthUnit, text, f"{path}, position")
    require_length(stated, unit, f"{path}: the file states positions in {text}")
    require_agreement(stated.value, named, path)
    return stated.value


def stated_length(data: xr.Dataset, path: Path) -> float | None:
    """Find one of the positions' unit in m by their attribute; None if there is none."""
    texts = [str(data[name].attrs.get("units", "")) for name in ("position", "x") if name in data]
    stated = next(filter(None, texts), "")
    return unit_named(LengthUnit, stated, f"{path}, position").value if stated else None


def require_length(stated: LengthUnit, unit: LengthUnit | None, said: str) -> None:
    """Complain unless the unit of lengths that is set, if one is, is the file's; `said` says it."""
    if unit not in (None, stated):
        raise UserError(
            f"{said}, the configuration instrument.length_unit={unit.name}; they must agree"
        )


def frequency_factor(frequency: xr.DataArray, named: float | None, path: Path) -> float:
    """Find one of the frequencies' unit in Hz, by their attribute or name.

    Raises
    ------
    UserError
        If they contradict, or the attribute is no unit of frequency.
    """
    text = str(frequency.attrs.get("units", ""))
    if not text:
        return named or UNSTATED_FREQUENCY
    stated = UNSTATED_FREQUENCY
    if text != FREQUENCY.units:
        try:
            stated = of_quantity(read_unit(text), "frequency").factor
        except UserError as error:
            raise UserError(f"{path}, frequency: {error}; correct its attribute units") from None
    require_agreement(stated, named, path)
    return stated


def require_errors_alike(
    data: xr.Dataset,
    factor: float,
    amplitude: Amplitude | None,
    unit: VelocityUnit | None,
    layout: FileLayout,
    path: Path,
) -> None:
    """Complain unless standard errors are in the unit of the velocities, `factor` in m/s."""
    text = str(data["velocity_std"].attrs.get("units", "")) if "velocity_std" in data else ""
    stated = _stated_velocity(text, unit, layout, path) if text else None
    if stated is None:
        return
    measure = layout.amplitude or amplitude
    if abs(stated.factor / factor - 1) > SAME or stated.amplitude not in (None, measure):
        own = data["velocity"].attrs.get("units", f"units of {factor:g} m/s")
        raise UserError(
            f"{path}: velocity_std is in {text}, velocity in {own}; they must be in the same unit"
        )


def require_agreement(stated: float, named: float | None, path: Path) -> None:
    """Complain unless the unit in a name is that of the attribute, if there is one."""
    if named is not None and abs(named / stated - 1) > SAME:
        raise _contradiction(path)


def _contradiction(path: Path) -> UserError:
    return UserError(f"{path}: the name of an array and its attribute units contradict")
