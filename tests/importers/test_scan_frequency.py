"""Numbers in Hz above a table: that of its values is read, others are asked about."""

from __future__ import annotations

import numpy as np
import pytest

from sldvexp.errors import UserError
from sldvexp.importers import PointwiseView, conventions
from sldvexp.importers.scan_export import ScanExport
from sldvexp.importers.scan_frequency import stated_in

NAMES = "Index\tX [m]\tY [m]\tZ [m]\tReal [µm]\tImag [µm]\n"
ROWS = "1\t0\t0\t0\t1.5\t-2\n2\t0.3\t0\t0\t4\t0.5\n3\t0.3\t0.2\t0\t-1\t3\n"
PEAKS = np.array([1.5 - 2j, 4 + 0.5j, -1 + 3j]) * 1e-6


@pytest.fixture
def read(tmp_path):
    def read_(text, **more):
        views = {}
        for name, origin in (("a", [0.0, 0.0, 1.5]), ("b", [1.0, 0.0, 1.0])):
            path = tmp_path / f"{name}.txt"
            path.write_text(text)
            views[name] = PointwiseView(path=str(path), origin=origin)
        return ScanExport(
            views=views,
            positive=conventions.Positive.towards,
            phase=conventions.Phase.exp_plus,
            amplitude=conventions.Amplitude.peak,
            **more,
        ).read()

    return read_


def right(group, frequency):
    """Compare velocities, which follow from displacements by the frequency."""
    np.testing.assert_allclose(group["frequency"], frequency, rtol=1e-14)
    expected = 2j * np.pi * np.array(frequency) * PEAKS[:, None]
    np.testing.assert_allclose(group["velocity"].sel(view="a"), expected, rtol=1e-12)


OTHERS = "Bandwidth:\t2 kHz\nResolution:\t0.625 Hz\nSample Freq.:\t5.12 kHz\nBand: 190 - 200 Hz\n"


@pytest.mark.one_in(3)
@pytest.mark.parametrize(
    ("line", "frequency"),
    [
        ("Frequency:\t195.00 Hz", 195),
        ("Frequenz [Hz]:\t195.00", 195),
        ("Frequenz [kHz];0,195", 195),
        ("Fréquence (Hz) = 195", 195),
        ("freq 0.195 kHz", 195),
        ("f/Hz: 195", 195),
        ("Frequency in Hz: 195", 195),
        ('"Frequency [Hz]"\t"195"', 195),
        ("195 Hz", 195),
        ("@ 195 Hz", 195),
        ("Signal: FFT\tFrequency: 195 Hz", 195),
        ("Frequency: 195 Hz\tBandwidth: 2 kHz", 195),
        ("# Frequency of the line: 195 Hz", 195),
    ],
)
@pytest.mark.parametrize("others", ["", OTHERS])
def test_line_of_the_frequency_is_found_among_others(read, line, frequency, others):
    right(read(f"{others}{line}\n{NAMES}{ROWS}"), [frequency])
    right(read(f"{line}\n{others}\n{NAMES}{ROWS}"), [frequency])


@pytest.mark.parametrize(
    ("lines", "numbers"),
    [
        ("Sample Freq.:\t5.12 kHz", "5120"),
        ("Bandwidth: 2 kHz", "2000"),
        ("Resolution: 0.625 Hz", "0.625"),
        ("Frequency resolution [Hz]: 0.625", "0.625"),
        ("Band: 190 - 200 Hz", "190, 200"),
        ("Frequency range: 0 to 2 kHz", "0, 2000"),
        ("Start frequency: 10 Hz\nEnd frequency: 2 kHz", "10, 2000"),
        ("Frequenzauflösung: 1 Hz\nAbtastfrequenz: 5,12 kHz", "1, 5120"),
        ("Frequency: 190 - 200 Hz", "190, 200"),
        ("Frequency [Hz]: 190 - 200", "190, 200"),
        ("Frequency: 190 Hz - 200 Hz", "190, 200"),
        ("Frequency: 195 Hz\nFrequenz [Hz]: 440", "195, 440"),
        ("Frequency: 195 Hz\n440 Hz", "195, 440"),
        ("195 Hz bandwidth", "195"),
    ],
)
def test_other_numbers_are_named_in_the_question(read, lines, numbers):
    text = f"{lines}\n{NAMES}{ROWS}"
    with pytest.raises(UserError, match=rf"states {numbers} Hz\).*instrument\.frequency"):
        read(text)
    right(read(text, frequency=[195.0]), [195])


def test_pages_repeat_what_is_no_frequency(read):
    head = OTHERS + "Frequency: 195 Hz\n" + NAMES
    behind = "Frequency: 195 Hz\n" + OTHERS + NAMES
    lines = ROWS.splitlines(keepends=True)
    for page in (head, behind):
        right(read(page + "".join(lines[:2]) + page + lines[2]), [195])


def test_blocks_have_the_frequency_of_their_own_line(read):
    for heading in ("Frequency: {} Hz\n", "Frequenz [Hz]: {}\n"):
        for before, after in ((OTHERS, ""), ("", OTHERS)):
            text = "".join(
                before + heading.format(f) + after + NAMES + ROWS for f in ("195.00", "440.00")
            )
            right(read(text), [195, 440])


def test_blocks_of_other_bands_are_refused(read):
    text = "".join(f"Band: {band} Hz\n{NAMES}{ROWS}" for band in ("190 - 200", "430 - 450"))
    with pytest.raises(UserError, match="Band: 430 - 450 Hz' states frequencies, and not one as"):
        read(text, frequency=[195.0])


def test_no_number_is_stated_without_hertz():
    assert stated_in(["Frequency: 195", "FFT Lines: 3200", "Page 2"]).all == []
