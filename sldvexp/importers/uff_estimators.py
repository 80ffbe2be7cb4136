"""Estimates from spectra and time records of universal files, and their errors.

With the averaged cross spectrum ``G_xf`` of a response x and a reference f, and their auto spectra
``G_xx`` and ``G_ff``, the response function is ``H1 = G_xf / G_ff``, unbiased if only the response
is noisy, or ``H2 = G_xx / G_fx``, unbiased if only the reference is; the coherence
``|G_xf|^2 / (G_xx G_ff)`` is their ratio. Hv lies between them (see
`sldvexp.signal.response_function`).

A time record is taken for a sum of sines of known frequencies, ``a + sum Re(Z exp(i omega t))``,
whose phasors Z come from linear least squares, with their errors from the residuals: white noise
is assumed.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from sldvexp.errors import UserError
from sldvexp.importers.questions import close
from sldvexp.importers.uff_conventions import FunctionKind
from sldvexp.io.uff import Function, UniversalFile
from sldvexp.io.uff.functions import DIRECTIONS
from sldvexp.signal import Estimator
from sldvexp.signal.response_function import estimate
from sldvexp.typing import Array, ComplexArray, IndexArray
from sldvexp.unit_labels import SpectralForm, UnitNotUnderstoodError, read_unit

AUTO = 2
#: By how much rounded spectra may make a coherence larger than 1.
ROUNDING = 1e-4


def no_estimator(file: UniversalFile) -> UserError:
    """Ask how response functions are made of cross spectra."""
    return UserError(
        f"{file.source.path}: has cross spectra, of which response functions are made in three "
        "ways; say it with instrument.estimator=h1 (divided by the reference's auto spectrum: "
        "noise is in the responses), h2 (of the response's: noise is in the reference) or hv "
        "(noise is in both, as instrument.noise_ratio says)"
    )


def no_reference(file: UniversalFile) -> UserError:
    """Ask what the phase of time records is from."""
    return UserError(
        f"{file.source.path}: does not state what time records have their phase from; say it "
        "with instrument.time_reference, as 99+Z (the record of that degree of freedom) or "
        f"{TRIGGER} (records begin at one phase of the excitation)"
    )


def no_frequency(file: UniversalFile) -> UserError:
    """Ask for the frequencies of time records."""
    return UserError(
        f"{file.source.path}: does not state at which frequencies its time records are to be "
        "evaluated; say it with instrument.frequency, for example instrument.frequency=[197]"
    )


def estimate_response(
    estimator: Estimator | None,
    noise_ratio: float,
    containing: str,
    file: UniversalFile,
    crosses: list[Function],
    values: ComplexArray,
    frequency: Array,
    lines: IndexArray,
) -> ComplexArray:
    """Estimate response functions H1, H2 or Hv.

    Parameters
    ----------
    noise_ratio : float
        Of Hv: noise power of the response over that of the reference, in the file's units.
    containing : str
        Text that chooses among several auto spectra of one degree of freedom.
    crosses : list of Function
        Cross spectra ``G_xf``, one a node.
    values : ndarray of complex, shape (function, frequency)
        Of these.
    frequency : ndarray, shape (frequency,), Hz
    lines : ndarray of int, shape (frequency,)
        Places of the frequencies in the abscissa.

    Returns
    -------
    ndarray of complex, shape (function, frequency)
        Zero where a cross spectrum is zero throughout.

    Raises
    ------
    UserError
        If the estimator is not set, or an auto spectrum is missing or zero.
    """
    if estimator is None:
        raise no_estimator(file)
    autos = partial(_autos, containing, file, crosses, frequency, lines)
    if estimator is Estimator.h1:
        return values / autos(of_reference=True)
    response = autos(of_reference=False)
    # H2 takes nothing from the reference's auto spectrum, which the file need not have.
    reference = autos(of_reference=True) if estimator is Estimator.hv else np.ones(response.shape)
    measured = values.any(axis=1)
    for function, row in zip(crosses, values, strict=True):
        if row.any() and not row.all():
            at = frequency[int(np.argmax(row == 0))]
            name = estimator.name.capitalize()
            raise file.wrong(
                function, f"the cross spectrum is zero at {at:g} Hz, where {name} is none"
            )
    found = np.zeros_like(values)
    some = reference[measured], response[measured], values[measured]
    found[measured] = estimate(*some, estimator, noise_ratio)
    return found


def coherence(
    containing: str,
    file: UniversalFile,
    crosses: list[Function],
    frequency: Array,
    lines: IndexArray,
) -> Array:
    """Form the coherence ``|G_xf|^2 / (G_xx G_ff)``, shape (function, frequency)."""
    square = np.array([abs(file.values(f)[1][lines]) ** 2 for f in crosses])
    for of_reference in (True, False):
        square /= _autos(containing, file, crosses, frequency, lines, of_reference)
    for function, row in zip(crosses, square, strict=True):
        if not ((row > 0) & (row <= 1 + ROUNDING)).all():
            raise file.wrong(
                function,
                f"with the auto spectra its coherence is {row.min():.4g} to {row.max():.4g}, and "
                "must be above 0 and up to 1; are they of one scale?",
            )
    return np.minimum(square, 1.0)


def _autos(
    containing: str,
    file: UniversalFile,
    crosses: list[Function],
    frequency: Array,
    lines: IndexArray,
    of_reference: bool,
) -> Array:
    """Read the auto spectra that belong to cross spectra, shape (function, frequency)."""
    found: dict[tuple[int, int], Array] = {}
    rows = []
    for cross in crosses:
        dof = (cross.node, cross.direction)
        if of_reference:
            dof = (cross.reference_node, cross.reference_direction)
        if dof not in found:
            auto = _auto(containing, file, cross, dof, "reference" if of_reference else "response")
            abscissa, values = file.values(auto)
            if len(abscissa) <= lines.max() or not close(abscissa[lines], frequency):
                message = f"has other frequencies than data set {cross.entry.number}"
                raise file.wrong(auto, f"{message}, whose auto spectrum it is")
            values = values[lines]
            wrong = ~((values.real > 0) & (abs(values.imag) <= ROUNDING * values.real))
            if wrong.any():
                raise file.wrong(
                    auto,
                    f"an auto spectrum must be real and above zero, but at "
                    f"{frequency[int(np.argmax(wrong))]:g} Hz it is {values[wrong][0]:g}; choose "
                    "other lines with instrument.frequency",
                )
            found[dof] = np.asarray(values.real, float)
        rows.append(found[dof])
    return np.array(rows)


def _auto(
    containing: str, file: UniversalFile, cross: Function, dof: tuple[int, int], of: str
) -> Function:
    """Find the one auto spectrum of a degree of freedom."""
    autos = [f for f in file.functions if f.kind == AUTO and (f.node, f.direction) == dof]
    if len(autos) > 1:
        autos = [f for f in autos if containing in " ".join(f.text)]
    name = f"{dof[0]}{DIRECTIONS.get(dof[1], '') if dof[1] else ''}"
    if len(autos) != 1:
        raise file.wrong(
            cross,
            f"needs one auto spectrum of its {of} {name} (function type {AUTO}) in the file for "
            f"{'H1' if of == 'reference' else 'H2'} or the coherence; there are {len(autos)}",
        )
    _require_one_scale(file, cross, autos[0], of)
    return autos[0]


def _require_one_scale(file: UniversalFile, cross: Function, auto: Function, of: str) -> None:
    """Refuse a cross spectrum and an auto spectrum whose labels contradict each other.

    A label that is not understood is asked about where it is needed, and says nothing here.
    """
    labels = []
    for function in (cross, auto):
        try:
            labels.append(read_unit(function.ordinate.unit))
        except UnitNotUnderstoodError:
            return
    both = f"is in {cross.ordinate.unit}, its auto spectrum in {auto.ordinate.unit}; "
    whole, square = labels
    if (whole.form is SpectralForm.density) is not (square.form is SpectralForm.density):
        raise file.wrong(cross, f"{both}both must be powers, or both power densities")
    one = read_unit(whole.reference) if of == "reference" and whole.reference else whole
    known = of == "response" or bool(whole.reference) or whole.form is not SpectralForm.linear
    if known and abs(one.factor / square.factor - 1) > ROUNDING:
        raise file.wrong(cross, f"{both}the {of} must be in one unit in both")


#: Setting `time_reference` of records that begin at one phase of the excitation.
TRIGGER = "trigger"
#: Amplitude of the reference over its standard error, below which it has no phase.
LEAST_RATIO = 10.0


def find_reference(wanted: str, file: UniversalFile) -> Function | None:
    """Find the record whose phase is zero, of the degree of freedom `wanted`.

    Returns
    -------
    Function or None
        None if `wanted` is `TRIGGER`.

    Raises
    ------
    UserError
        If `wanted` is empty, or there is not one record of that degree of freedom.
    """
    if not wanted:
        raise no_reference(file)
    if wanted == TRIGGER:
        return None
    found = [f for f in file.functions if f.kind == FunctionKind.time.value and f.dof == wanted]
    if len(found) != 1:
        raise UserError(
            f"{file.source.path}: has {len(found)} time records of {wanted}, which "
            "instrument.time_reference names; it must have one"
        )
    return found[0]


def fit_phasors(
    wanted: list[float],
    file: UniversalFile,
    functions: list[Function],
    reference: Function | None,
) -> tuple[Array, ComplexArray, Array]:
    """Fit peak phasors of the records, of exp(+i omega t), relative to the reference's phase.

    Parameters
    ----------
    wanted : list of float, Hz
    functions : list of Function
        Time records.
    reference : Function, optional
        Record whose phase is zero; None if all begin at one phase of the excitation.

    Returns
    -------
    frequency : ndarray, shape (frequency,), Hz
        As wanted.
    phasor : ndarray of complex, shape (function, frequency)
        In the file's unit; 0 of a record of zeros.
    std : ndarray, shape (function, frequency)
        Standard error from the record's residuals, of real and imaginary part each.
    """
    if not wanted:
        raise no_frequency(file)
    frequency = np.array(wanted)
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
    """Fit the phasors of one record ``a + sum Re(Z exp(i omega t))``, with their errors."""
    t, y = file.values(function)
    unknowns = 1 + 2 * len(frequency)
    if np.iscomplexobj(y) or len(y) <= unknowns:
        raise file.wrong(function, f"must be a real record of more than {unknowns} values")
    angle = 2 * np.pi * np.outer(t, frequency)
    # Re(Z exp(i angle)) = Re(Z) cos(angle) - Im(Z) sin(angle)
    design = np.column_stack([np.ones(len(t)), np.cos(angle), -np.sin(angle)])
    solution, _, rank, _ = np.linalg.lstsq(design, y, rcond=None)
    if rank < unknowns:
        raise file.wrong(function, "cannot tell the frequencies apart: the record is too short")
    residual = y - design @ solution
    s2 = residual @ residual / (len(y) - unknowns)
    variance = s2 * np.diag(np.linalg.inv(design.T @ design))[1:].reshape(2, -1)
    real, imag = solution[1:].reshape(2, -1)
    return real + 1j * imag, np.sqrt(np.maximum(variance.max(axis=0), np.finfo(float).tiny))
