"""Any excitation on the virtual lab: exact motion, noise and drop-outs of each record."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sldvexp.instrument import Acquisition, Status
from sldvexp.signal import Excitation, ExcitationKind, LineChoice
from sldvexp.virtual_lab.transients import long_period

RATE, SAMPLES = 5120.0, 1024
#: Steps from the edge of the plate to the middle of it.
PIXELS = np.stack([np.linspace(-500, 500, 7), np.linspace(-1300, 0, 7)], axis=1).astype(int)


def acquisition(kind, records=3, samples=SAMPLES, triggered=True, **more):
    played = Excitation(kind, [50.0, 1325.0], **{"amplitude": 1.0, **more})
    design = played.design(RATE, samples)
    return Acquisition(RATE, samples, (), 1.0, design, records, 1, triggered)


def records(lab, how, dac=PIXELS, stream=0):
    lab.configure(how)
    found = lab.scan(dac, stream=stream)
    volts = found.counts * found.volts_per_count[:, None]
    return volts.reshape(len(dac), how.records, 2, how.samples), found.status


@pytest.mark.one_in(2)
@pytest.mark.parametrize("triggered", [True, False])
@pytest.mark.parametrize("kind", ["multisine", "chirp", "pseudo_random"])
def test_what_repeats_moves_as_the_response_says(quiet, kind, triggered):
    """A record that starts anywhere in the period has no leakage, whatever its phase."""
    ours = quiet("plate", target=None)
    how = acquisition(ExcitationKind[kind], triggered=triggered)
    volts, _ = records(ours, how)
    velocity, reference = np.moveaxis(how.drive.spectra(volts), 2, 0) / [[[[100.0]]], [[[1.0]]]]
    truth = ours.true_velocity(PIXELS, how.drive.frequency)
    # A count is 3e-4 V; its error at a line is that over the root of half the samples.
    noise = 10 / 2**15 / 100 / np.sqrt(12 * SAMPLES / 2) / np.abs(reference).min()
    error = velocity / reference - truth[:, None]
    assert np.abs(error).max() < 8 * noise
    assert np.abs(truth).max() > 1000 * noise


def test_a_burst_dies_as_the_slowest_mode_does(quiet):
    """Behind the burst, what is left of one mode falls with its damping."""
    others = ["bending_2_1", "bending_1_2", "bending_2_2", "bending_3_1", "stretch_x", "stretch_y"]
    still = [f"scene.plate.modes.{name}.velocity=0" for name in others]
    ours = quiet("plate", *still, target=None)
    how = acquisition(ExcitationKind.burst_random, records=4, burst=0.2)
    volts, _ = records(ours, how, PIXELS[3:4])
    tail = volts[0, :, 0, 256:]
    half = tail.shape[1] // 2
    fell = np.log((tail[:, half:] ** 2).sum(axis=1) / (tail[:, :half] ** 2).sum(axis=1))
    rate = 2 * 0.01 * 2 * np.pi * 197.0
    np.testing.assert_allclose(fell, -rate * half / RATE, rtol=0.02)
    assert (volts[0, :, 1, 256:] == 0).all()


def test_noise_goes_on_from_record_to_record_and_leaks(quiet):
    ours = quiet("plate", target=None)
    how = acquisition(ExcitationKind.random, records=40)
    volts, _ = records(ours, how, PIXELS[3:4])
    played = long_period(how.drive)
    reference = volts[0, :, 1].ravel()
    lag = np.fft.irfft(np.fft.rfft(played) * np.conj(np.fft.rfft(reference, len(played))))
    start = int(lag.argmax())
    again = np.roll(played, -start)[: len(reference)]
    np.testing.assert_allclose(reference, again, atol=5 / 2**15)
    y, x = np.moveaxis(
        how.drive.spectra(volts[0])[:, :, np.argmin(abs(how.drive.frequency - 195))], 1, 0
    )
    coherence = abs((x.conj() * y).sum()) ** 2 / (abs(x) ** 2).sum() / (abs(y) ** 2).sum()
    assert coherence < 0.8


def test_a_blow_meets_a_structure_at_rest(quiet):
    ours = quiet("plate", target=None)
    how = acquisition(ExcitationKind.hammer, records=3, amplitude=4.0, samples=2048)
    volts, _ = records(ours, how)
    np.testing.assert_array_equal(volts[:, 0], volts[:, 1])
    before = int(0.019 * how.samples)
    # What is there before is the ringing of a band that ends, not what an earlier blow left.
    assert np.abs(volts[:, :, 0, :before]).max() < 0.02 * np.abs(volts[:, :, 0]).max()


def test_a_pixel_is_the_same_wherever_it_stands_in_calls(lab):
    """Bits depend on the seed, the view, the stream and the place in it, and on nothing else."""
    ours = lab("plate", "scene.vibrometer.drop_out=0.3", target=None, seed=4)
    how = acquisition(ExcitationKind.random, triggered=False)
    whole, status = records(ours, how, stream=7)
    ours.start_stream(7)
    parts = [ours.scan(PIXELS[:3]), ours.scan(PIXELS[3:])]
    scale = parts[0].volts_per_count[:, None]
    again = np.concatenate([part.counts for part in parts]) * scale
    np.testing.assert_array_equal(whole.reshape(-1, 2, SAMPLES), again)
    np.testing.assert_array_equal(status, np.concatenate([part.status for part in parts]))
    other, _ = records(ours, how, stream=8)
    assert (other[:, :, 1] != whole[:, :, 1]).mean() > 0.9  # another start, another noise


def test_each_record_drops_out_by_itself(lab):
    share, count = 0.1, 400
    ours = lab("plate", f"scene.vibrometer.drop_out={share}", target=None)
    how = acquisition(ExcitationKind.multisine, records=10, samples=128)
    dac = np.tile(PIXELS[3], (count, 1))
    _, status = records(ours, how, dac)
    lost = (status & Status.dropped_out).reshape(count, 10) > 0
    spread = 4 * np.sqrt(share * (1 - share) / lost.size)
    assert abs(lost.mean() - share) < spread
    of_pixels = 1 - (1 - share) ** 10
    assert abs(lost.any(axis=1).mean() - of_pixels) < 4 * np.sqrt(0.25 / count)


def test_a_curved_characteristic_shows_on_lines_that_are_not_excited(quiet):
    """Of a sine it is exactly the harmonics that are asked for."""
    plain = quiet("plate", target=None)
    curved = quiet("plate", "scene.vibrometer.harmonics=[0.01]", target=None)
    how = acquisition(ExcitationKind.multisine, lines=LineChoice.odd)
    even = np.arange(24, 500, 2)
    found = [np.fft.rfft(records(one, how)[0][:, 0, 0])[:, even] for one in (plain, curved)]
    assert np.abs(found[1]).max() > 30 * np.abs(found[0]).max()
    tone = replace(
        how, drive=Excitation(ExcitationKind.multisine, [199.0, 201.0]).design(RATE, SAMPLES)
    )
    sine = np.abs(np.fft.rfft(records(curved, tone)[0][:, 0, 0]))
    np.testing.assert_allclose(sine[:, 80] / sine[:, 40], 0.01, rtol=0.02)


def test_a_missed_trigger_gives_a_record_without_a_blow(quiet):
    ours = quiet("plate", "scene.digitizer.missed_trigger=0.2", target=None)
    how = acquisition(ExcitationKind.hammer, records=10, samples=256)
    volts, _ = records(ours, how, np.tile(PIXELS[3], (100, 1)))
    hit = np.abs(volts[:, :, 1]).max(axis=2) > 0.5
    assert abs(hit.mean() - 0.8) < 4 * np.sqrt(0.8 * 0.2 / hit.size) + 0.2 / 16


def test_no_two_records_of_a_pixel_have_the_same_noise_however_many_there_are(quiet):
    ours = quiet("plate", target=None)
    how = acquisition(ExcitationKind.random, records=260, samples=64)
    reference = records(ours, how, PIXELS[3:4])[0][0, :, 1]
    alike = np.corrcoef(reference) - np.eye(260)
    assert np.abs(alike).max() < 0.9  # of 64 samples of a band; the same noise has 1
