"""One view by a person: marks that the beam was pointed at, spots that were digitised."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial

import numpy as np

from sldvexp.errors import UserError
from sldvexp.instrument.person import Attended, Mark, Person, Steps
from sldvexp.instrument.recorded_person import mark_name, spot_name
from sldvexp.io.registration.netcdf import from_dataset, to_dataset
from sldvexp.io.registration.table import RegistrationTable
from sldvexp.lazy import xarray as xr
from sldvexp.scan.by_digitizer import ByDigitizer
from sldvexp.scan.by_hand import ByHand
from sldvexp.session.standpoint import Standpoint
from sldvexp.session.terminal import AtTerminal
from sldvexp.targets.base import Target
from sldvexp.targets.circles import Circles
from sldvexp.typing import Array, IntArray
from sldvexp.units import LengthUnit

GROUP = "registration"
HOME: Steps = (0, 0)


def take_marks(scan: ByHand, at: Standpoint) -> dict[str, xr.Dataset]:
    """The marks that a person can point at in a view; the group ``registration/<view>``.

    Raises
    ------
    UserError
        If there are no marks, or all are hidden.
    """
    beam, found, dac = HOME, [], []
    taken: dict[Steps, int] = {}
    for mark in known_marks(scan, at.target):
        if mark.number in scan.views[at.view].hidden:
            continue
        aim = partial(_aim, at, mark, beam, taken)
        kept = at.camera.journal.answer(mark_name(mark.number), mark.position.tolist(), aim)
        if kept is not None:
            beam = (kept[0], kept[1])
            found.append(mark)
            dac.append(beam)
            taken[beam] = mark.number
    if not found:
        raise UserError(f"scan: none of the marks can be seen from the view {at.view}")
    numbers = np.array([mark.number for mark in found])
    position = np.array([mark.position for mark in found])
    std = np.array([mark.std for mark in found])
    return _group(at, numbers, position, std, np.array(dac, float))


def take_spots(scan: ByDigitizer, at: Standpoint) -> dict[str, xr.Dataset]:
    """The digitised spots of a view; the group ``registration/<view>``.

    A spot is a point of the structure that no other view has, and so has a number of its own.
    """
    dac = scan.known_pixels(at.view)
    before = list(scan.views)[: list(scan.views).index(at.view)]
    first = 1 + sum(len(scan.known_pixels(view)) for view in before)
    places = []
    for spot, steps in enumerate(dac.tolist(), 1):
        measure = partial(_digitise, scan, at, spot, steps)
        asked = [*steps, scan.samples]
        places.append(at.camera.journal.answer(spot_name(spot), asked, measure))
    sampled = np.array(places)
    std = None
    if scan.samples > 1:
        std = sampled.std(axis=1, ddof=1) / np.sqrt(scan.samples)
    numbers = np.arange(first, first + len(dac))
    return _group(at, numbers, sampled.mean(axis=1), std, dac.astype(float))


def joined(found: Mapping[str, xr.Dataset]) -> dict[str, xr.Dataset]:
    """The groups of a session with those of single views' registration as one."""
    views = [group for name, group in found.items() if name.startswith(f"{GROUP}/")]
    others = {name: g for name, g in found.items() if not name.startswith(f"{GROUP}/")}
    if not views:
        return others
    tables = [table for group in views for table in from_dataset(group, "")]
    return others | {GROUP: to_dataset(tables)}


def known_marks(scan: ByHand, target: Target | None) -> list[Mark]:
    """The scan's own marks, or the points of the target.

    Raises
    ------
    UserError
        If there are neither, or those are the circles of a calibration object.
    """
    source = scan.own_marks() or target
    # Nobody sees where the bitangents of circles touch.
    if source is None or isinstance(source, Circles):
        raise UserError(
            "scan=by_hand needs marks to point at: choose target=fiducials, or give scan.fiducials"
        )
    points = source.points()
    every = zip(points.number, points.position, points.std, strict=True)
    return [Mark(int(number), position, std) for number, position, std in every]


def person_at(
    at: Standpoint, unit: LengthUnit = LengthUnit.m, taken: Mapping[Steps, int] | None = None
) -> Person:
    """Who does what the instrument cannot: a simulated one's own person, or the one we ask."""
    instrument = at.camera.instrument
    if isinstance(instrument, Attended):
        return instrument.person
    return AtTerminal(at.operator, instrument, at.laser, at.view, unit, taken)


def _aim(at: Standpoint, mark: Mark, start: Steps, taken: Mapping[Steps, int]) -> Steps | None:
    """Let a person bring the beam onto a mark, at other steps than those of earlier marks."""
    return person_at(at, taken=taken).aim(mark, start)


def _digitise(
    scan: ByDigitizer, at: Standpoint, spot: int, steps: Steps
) -> list[tuple[float, float, float]]:
    """Send the beam to its DAC steps and measure where it falls, in m."""
    at.camera.instrument.move(steps)
    return person_at(at, scan.unit).digitise(spot, scan.samples)


def _group(
    at: Standpoint,
    number: IntArray,
    position: Array,
    std: Array | None,
    dac: Array,
) -> dict[str, xr.Dataset]:
    """Registration data of one view."""
    angle = at.laser.angle_from_dac(dac)
    table = RegistrationTable(at.view, number, position, angle, dac, object_std=std)
    return {f"{GROUP}/{at.view}": to_dataset([table])}
