"""Head lines of files: which state what their values are, and which speak of something else."""

from __future__ import annotations

import time

import pytest

from sldvexp.io.statements import Known, Statement, statement_in
from sldvexp.unit_labels import Amplitude

RMS, PEAK, P_P = Amplitude.rms, Amplitude.peak, Amplitude.peak_to_peak
IN_M = {"m/s": 1.0, "mm/s": 1e-3, "µm/s": 1e-6, "in/s": 0.0254, "µm": 1e-6, "mm": 1e-3, "nm": 1e-9}
IN_M |= {"mil": 2.54e-5, "g": 9.80665, "m/s²": 1.0, "m/N": 1.0, "m": 1.0, "ft": 0.3048}

#: Lines with quantity, unit and measure that they state.
HEEDED: list[tuple[str, str, str, Amplitude | None]] = [
    ("Velocity [mm/s] RMS", "velocity", "mm/s", RMS),
    ("# velocity in mm/s, rms", "velocity", "mm/s", RMS),
    ("% Vibration velocity (mm/s), rms values", "velocity", "mm/s", RMS),
    ("Units: in/s", "", "in/s", None),
    ("units: in/s pk", "", "in/s", PEAK),
    ("Unit = mm/s", "", "mm/s", None),
    ("# units in um/s", "", "µm/s", None),
    ("peak-peak", "", "", P_P),
    ("Amplitude: peak-to-peak", "", "", P_P),
    ("Amplitudes are zero-to-peak", "", "", PEAK),
    ("Magnitude (pk-pk)", "", "", P_P),
    ("displacement", "displacement", "", None),
    ("Displacement (um p-p)", "displacement", "µm", P_P),
    ("Displacement, µm 0-pk", "displacement", "µm", PEAK),
    ("Vib Displacement", "displacement", "", None),
    ("Acceleration, g rms", "acceleration", "g", RMS),
    ("Acceleration [m/s^2]", "acceleration", "m/s²", None),
    ("Values are RMS", "", "", RMS),
    ("all values rms", "", "", RMS),
    ("RMS", "", "", RMS),
    ("RMS velocity", "velocity", "", RMS),
    ("Signal: RMS velocity of the scan", "velocity", "", RMS),
    ("rms values in m/s", "", "m/s", RMS),
    ("Signal:\tVib Velocity RMS", "velocity", "", RMS),
    ("FFT Vib Velocity", "velocity", "", None),
    ("H1 Velocity / Voltage", "velocity", "", None),
    ("H1 Vib Velocity / Ref1 Force", "velocity", "", None),
    ("Displacement/Force", "displacement", "", None),
    ("FRF Displacement [m/N]", "displacement", "m/N", None),
    ("Channel: Vib & Ref1; Signal: H1 Acceleration", "acceleration", "", None),
    ("Mobility", "velocity", "", None),
    ("Accelerance, point 12+Z", "acceleration", "", None),
    ("Data type: Acceleration", "acceleration", "", None),
    ("Y-axis: Displacement", "displacement", "", None),
    ("Ordinate unit: mm/s", "", "mm/s", None),
    ("Plate 7, Velocity [mm/s] RMS, Miller", "velocity", "mm/s", RMS),
    ("Bauteil 7: Schwinggeschwindigkeit [mm/s], Effektivwert", "velocity", "mm/s", RMS),
    ("Geschwindigkeit in mm/s (effektiv)", "velocity", "mm/s", RMS),
    ("Einheit: mm/s", "", "mm/s", None),
    ("Beschleunigung in m/s²", "acceleration", "m/s²", None),
    ("Auslenkung Spitze-Spitze in µm", "displacement", "µm", P_P),
    ("Amplitude: Spitzenwert", "", "", PEAK),
    ("vitesse efficace (mm/s)", "velocity", "mm/s", RMS),
    ("déplacement crête à crête", "displacement", "", P_P),
    ("Velocidad en mm/s, valor eficaz", "velocity", "mm/s", RMS),
    ("spostamento picco-picco", "displacement", "", P_P),
    ("velocity spectrum, 0-pk", "velocity", "", PEAK),
    ("Exported 2024-05-01, mode 3, velocity mm / s rms", "velocity", "mm/s", RMS),
    ("Velocity RMS at 195 Hz", "velocity", "", RMS),
    ("Velocity_RMS", "velocity", "", RMS),
    ("velocity_units: mm/s", "velocity", "mm/s", None),
    ("root mean square velocity", "velocity", "", RMS),
    ("coordinates in mm, velocity in m/s rms", "velocity", "m/s", RMS),
    ("velocity data, units in/s, p-p", "velocity", "in/s", P_P),
    ("100 x 200 mm plate, velocity RMS", "velocity", "", RMS),
    ("FRF\tVelocity [mm/s] RMS\tAveraging: 16", "velocity", "mm/s", RMS),
    ("displacement in mils peak to peak", "displacement", "mil", P_P),
    ("Schwingweg [nm]", "displacement", "nm", None),
    ("Signal: FFT - Vib Velocity - Magnitude", "velocity", "", None),
    ("Vib\tVelocity\tm/s", "velocity", "m/s", None),
    ("Amplitude format: RMS", "", "", RMS),
    ("scaled to peak", "", "", PEAK),
    ("Acc [g]", "", "g", None),
]

#: Lines that state nothing of the values.
LEFT_ALONE = [
    "",
    "RMS averaging",
    "Averaging: RMS, 16 averages",
    "Averaging:\tRMS",
    "magnitude averaging",
    "Complex averaging of velocity spectra",
    "peak hold",
    "Peak-hold averaging",
    "Average type: peak",
    "Mittelung: RMS",
    "Mittelungsart Betrag, 10 Mittelungen",
    "Vibrometer velocity 50 mm/s/V range",
    "Velocity range 100 mm/s",
    "Range: 100 mm/s",
    "Decoder: VD-09 50 mm/s/V LP",
    "Velocity decoder VD-06",
    "Displacement decoder off",
    "Sensitivity 10 mm/s/V",
    "Messbereich Geschwindigkeit 500 mm/s",
    "Empfindlichkeit 125 mm/s/V",
    "max. velocity 20 m/s",
    "Maximum displacement",
    "Full scale velocity (peak) 0.5 m/s",
    "Peak at 195 Hz",
    "Peak frequency 440 Hz",
    "Peak search: on",
    "Picking of peaks, 3 found",
    "Resonance peak no. 3",
    "Operator: R. Peak",
    "Operator: Peak, R.",
    r"File: C:\data\velocity_rms.svd",
    "Source file: /home/miller/acceleration/run_3.svd",
    "velocity_rms.svd",
    "Noise floor 0.1 um/s rms",
    "noise: 2 nm rms",
    "Excitation: white noise, 1 N rms",
    "Generator: 5 V peak",
    "Generator amplitude 2 Vpp",
    "Sine, 1 V p-p",
    "Trigger level 10 % peak",
    "Window: flat top, peak amplitude error 0.01 dB",
    "Scan speed 10 mm/s",
    "Sound velocity 343 m/s",
    "Wave velocity in the plate in m/s",
    "Reference: acceleration",
    "Ref1: accelerometer 100 mV/g",
    "Reference channel: displacement [um] p-p",
    "Velocity and displacement of the same points",
    "Integration: velocity -> displacement",
    "Converted from acceleration in g",
    "to be compared with displacement measurements of 2019",
    "Alignment error 0.3 mm rms",
    "3D alignment rms: 0.4 mm",
    "Velocity resolution 0.02 um/s/sqrt(Hz)",
    "Overload at peak velocity",
    "Phase reference: Ref1",
    "Phase velocity",
    "Coordinate system: Cartesian",
    "Coordinates: global",
    "Board thickness [mm] 2",
    "Stand-off distance in mm: 950",
    "Frequency resolution 1 Hz",
    "Units: SI",
    "Units: mm",
    "RMS Queen Mary, hull plate",
    "Units of force: N",
    "Mode 3 at 195 Hz",
    "Tracking filter: slow",
    "VibSoft 5.3, PSV-500",
    "not rms but see manual",
    "Crest factor (peak/rms) 1.4",
    "Point 12",
    "Phase at 0 deg",
    "origin of coordinates at corner, mm",
    "Length of the beam in mm: 300",
    "dB re 1 um/s",
    "Average RMS velocity over all points",
    "Displacement computed from velocity",
    "true peak detector off",
    "The true velocities are (0.1+0.2i, -0.3, 5-1i), (-0.2, 0.1-0.1i, 2+1i) mm/s.",
    "Peter Grad, Weg 3",
]


@pytest.mark.parametrize(("line", "quantity", "unit", "amplitude"), HEEDED)
def test_line_that_states_quantity_unit_or_measure_is_heeded(
    line: str, quantity: str, unit: str, amplitude: Amplitude | None
) -> None:
    said = statement_in(line)
    assert said.quantity == quantity
    assert (said.unit is not None) == bool(unit)
    if said.unit is not None:
        assert said.unit.factor == pytest.approx(IN_M[unit], rel=1e-12)
    assert said.amplitude is amplitude


@pytest.mark.parametrize("line", LEFT_ALONE)
def test_line_that_speaks_of_something_else_is_left_alone(line: str) -> None:
    assert not statement_in(line), statement_in(line)


@pytest.mark.parametrize(
    ("line", "what", "value"),
    [
        ("phase in radians", "angle", "radian"),
        ("# Phase [deg]", "angle", "degree"),
        ("Phase: rad", "angle", "radian"),
        ("Magnitude in mm/s, phase in degrees", "angle", "degree"),
        ("time dependence exp(-iwt)", "phase", "exp_minus"),
        ("convention: exp(+j*omega*t)", "phase", "exp_plus"),
        ("x = X e^{iωt}", "phase", "exp_plus"),
        ("exp(j 2 pi f t)", "phase", "exp_plus"),
        ("positive velocity points away from the laser", "positive", "away"),
        ("Positive: towards vibrometer", "positive", "towards"),
        ("positive values are away from the surface", "positive", "towards"),
    ],
)
def test_line_that_states_a_phase_or_sense_is_heeded(line: str, what: str, value: str) -> None:
    assert getattr(statement_in(line), what) == value


@pytest.mark.parametrize(
    ("line", "factor"),
    [
        ("Coordinates in inches", 0.0254),
        ("Koordinaten [mm]", 1e-3),
        ("geometry units: mm", 1e-3),
        ("Length unit: mm", 1e-3),
        ("Unit of length = inch", 0.0254),
        ("Position units: mm; Velocity units: mm/s", 1e-3),
        ("position_units: cm", 1e-2),
        ("coordinates in mm, velocity in m/s rms", 1e-3),
    ],
)
def test_line_that_states_the_unit_of_coordinates_is_heeded(line: str, factor: float) -> None:
    length = statement_in(line).length
    assert length is not None
    assert length.factor == pytest.approx(factor)


def test_statements_that_contradict_what_is_known_are_named_by_the_setting() -> None:
    known = Known("velocity", 1.0, PEAK, length=1.0, angle="degree", phase="exp_plus")
    for line, setting, stated in (
        ("Velocity [mm/s]", "unit", "mm/s"),
        ("Displacement [mm]", "quantity", "displacement"),
        ("units: m/s²", "quantity", "acceleration"),
        ("peak-peak", "amplitude", "peak to peak"),
        ("coordinates in mm", "length_unit", "mm"),
        ("phase in radians", "angle", "radian"),
        ("exp(-iwt)", "phase", "exp_minus"),
    ):
        assert known.contradictions(statement_in(line)) == {setting: stated}
    assert not known.contradictions(statement_in("Velocity [m/s] pk, phase in degrees, exp(iwt)"))
    assert not Known().contradictions(statement_in("Velocity [mm/s] RMS"))


@pytest.mark.parametrize("piece", ["a/", "rms-", "1e", "(", "[", "\\", "peak to ", "=:", "m/s "])
def test_work_on_a_line_is_bounded(piece: str) -> None:
    start = time.process_time()
    for length in (40, 130, 400, 1_000_000):
        statement_in((piece * length)[:length])
    assert time.process_time() - start < 1.0


def test_zero_bytes_of_a_damaged_line_state_nothing() -> None:
    assert statement_in("\x00" * 8 + "p") == Statement()
    assert statement_in("\x000\x00 Velocity [mm/s] \x00") == statement_in("0 Velocity [mm/s]")
