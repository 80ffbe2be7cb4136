"""Time records of universal files: the phasors of their sines at given frequencies."""

from __future__ import annotations

import numpy as np

from sldvexp.errors import UserError
from sldvexp.importers.uff import Kind, Uff
from sldvexp.io.uff.functions import Function
from sldvexp.io.uff.reader import UniversalFile
from sldvexp.typing import Array, ComplexArray

#: What `time_reference` says of records that begin at one phase of the excitation.
TRIGGER = "trigger"
#: Amplitude of the reference over its standard error, below which it has no phase.
LEAST_RATIO = 10.0


def reference_of(settings: Uff, file: UniversalFile) -> Function | None:
    """The record whose phase is zero; None if all are triggered.

    Raises
    ------
    UserError
        If the settings do not say it, or there is not one record of that degree of freedom.
    """
    wanted = settings.time_reference
    if not wanted:
        raise UserError(
            f"{file.source.path}: does not state what time records have their phase from; say it "
            "with instrument.time_reference, as 99+Z (the record of that degree of freedom) or "
            f"{TRIGGER} (records begin at one phase of the excitation)"
        )
    if wanted == TRIGGER:
        return None
    found = [f for f in file.functions if f.kind == Kind.time.value and f.dof == wanted]
    if len(found) != 1:
        raise UserError(
            f"{file.source.path}: has {len(found)} time records of {wanted}, which "
            "instrument.time_reference names; it must have one"
        )
    return found[0]


def phasors(
    settings: Uff, file: UniversalFile, functions: list[Function], reference: Function | None
) -> tuple[Array, ComplexArray, Array]:
    """Peak phasors of the records, of exp(+i omega t), relative to the reference's phase.

    Returns
    -------
    frequency : ndarray, shape (frequency,), Hz
        As set.
    phasor : ndarray of complex, shape (function, frequency)
        In the file's unit; 0 of a record of zeros.
    std : ndarray, shape (function, frequency)
        Standard error from the record's residuals, of real and imaginary part each.
    """
    if not settings.frequency:
        raise UserError(
            f"{file.source.path}: does not state at which frequencies its time records are to be "
            "evaluated; say it with instrument.frequency, for example instrument.frequency=[197]"
        )
    frequency = np.array(settings.frequency)
    turn = np.ones(len(frequency), complex)
    if reference is not None:
        phasor, std = _phasor(file, reference, frequency)
        if (abs(phasor) < LEAST_RATIO * std).any():
            weak = frequency[(abs(phasor) / std).argmin()]
            raise file.wrong(reference, f"the reference has no clear sine of {weak:g} Hz")
        turn = abs(phasor) / phasor
    found = [_phasor(file, function, frequency) for function in functions]
    phasor, std = (np.array(column) for column in zip(*found, strict=True))
    return frequency, phasor * turn, std


def _phasor(
    file: UniversalFile, function: Function, frequency: Array
) -> tuple[ComplexArray, Array]:
    """Least-squares phasors of one record ``a + sum Re(Z exp(i omega t))``, and their errors."""
    t, y = file.values(function)
    unknowns = 1 + 2 * len(frequency)
    if np.iscomplexobj(y) or len(y) <= unknowns:
        raise file.wrong(function, f"must be a real record of more than {unknowns} values")
    angle = 2 * np.pi * np.outer(t, frequency)
    design = np.column_stack([np.ones(len(t)), np.cos(angle), -np.sin(angle)])
    solution, _, rank, _ = np.linalg.lstsq(design, y, rcond=None)
    if rank < unknowns:
        raise file.wrong(function, "cannot tell the frequencies apart: the record is too short")
    residual = y - design @ solution
    s2 = residual @ residual / (len(y) - unknowns)
    variance = s2 * np.diag(np.linalg.inv(design.T @ design))[1:].reshape(2, -1)
    real, imag = solution[1:].reshape(2, -1)
    return real + 1j * imag, np.sqrt(np.maximum(variance.max(axis=0), np.finfo(float).tiny))
