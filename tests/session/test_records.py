"""Averaging of records: spoilt ones are taken again, sums are kept, the worst is measured more."""

from __future__ import annotations

import shutil
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from sldvexp.dataset import take_findings
from sldvexp.errors import UserError
from sldvexp.instrument import RawSamples
from sldvexp.instrument.recording import read_line
from sldvexp.scan import Sampling
from sldvexp.session import Watcher, Wish
from sldvexp.session.records import Averaging, acquisition_of, added, once_more, worst_first
from sldvexp.session.session import scan_views
from sldvexp.signal import ExcitationKind, RecordFault, Response, ResponseSums

CORNERS = "[[-630, 130], [-630, -1400], [640, -1400], [640, 130]]"
RATE, SAMPLES = 5120.0, 512
#: A scan of averages in the view a.
AVERAGES = (
    "scan=rectangle",
    f"scan.views={{a: {{corners: {CORNERS}}}}}",
    "scan.pixels=[5,6]",
    "signal=response",
    f"scan.sampling.rate={RATE}",
    f"scan.sampling.samples={SAMPLES}",
    "scan.sampling.excitation=multisine",
    "scan.sampling.band=[50.0,1325.0]",
    "scene.digitizer.reference_range=10",
)


def scanned(composed, folder, *overrides):
    found = scan_views(composed(*AVERAGES, *overrides), folder)
    findings = take_findings(found)
    return found["image/a"], findings


def same(one, two):
    assert set(one.data_vars) == set(two.data_vars)
    for name, values in one.data_vars.items():
        np.testing.assert_array_equal(values, two[name], err_msg=name)


def test_a_spoilt_record_costs_a_record_and_is_taken_again(composed, tmp_path):
    lost = "scene.vibrometer.drop_out=0.2"
    image, findings = scanned(composed, tmp_path / "again", lost)
    assert (image["flags"] == 0).all()
    assert (image["records"] >= 10).all()
    spoilt = int(image["left_out"].sel(fault="dropped_out").sum())
    total = spoilt + int(image["records"].sum())
    assert abs(spoilt / total - 0.2) < 4 * np.sqrt(0.2 * 0.8 / total)
    assert [f.kind for f in findings] == ["records"]
    assert f"{spoilt} of {total} records are left out" in findings[0].text
    fewer, _ = scanned(composed, tmp_path / "never", lost, "scan.sampling.again=0")
    assert (fewer["flags"] == 0).all()
    left = fewer["left_out"].sel(fault="dropped_out") + fewer["records"]
    assert (left == 10).all()
    assert fewer["records"].min() < 10
    few, many = (np.median(i["velocity_std"]) for i in (fewer, image))
    assert few / many == pytest.approx(np.sqrt(9 / 7), rel=0.06)  # n - 1 of 10 and of 8


def test_a_pixel_without_two_good_records_is_flagged(composed, tmp_path):
    lost = ("scene.vibrometer.drop_out=0.7", "scan.sampling.again=1", "scan.sampling.records=2")
    image, _ = scanned(composed, tmp_path, *lost)
    few = image["records"].values < 2
    assert 0 < few.sum() < few.size
    np.testing.assert_array_equal(image["flags"].values != 0, few)


@pytest.mark.one_in(2)
@pytest.mark.parametrize("excitation", ["multisine", "random"])
def test_a_session_that_was_cut_off_goes_on_to_the_same_bits(composed, tmp_path, excitation):
    chosen = (
        f"scan.sampling.excitation={excitation}",
        "scan.sampling.trigger=free",
        "scan.sampling.spare=12.0",
        "scene.vibrometer.drop_out=0.2",
    )
    whole, _ = scanned(composed, tmp_path / "whole", *chosen)
    shutil.copytree(tmp_path / "whole", tmp_path / "cut")
    kept = sorted((tmp_path / "cut" / "a").glob("*.npz"))
    assert [path.stem for path in kept] == [*(f"image_00{k}" for k in range(5)), "once_more_000"]
    for path in (kept[1], kept[4], kept[5]):
        path.unlink()
    again, _ = scanned(composed, tmp_path / "cut", *chosen)
    same(whole, again)
    more = whole["records"].values >= 20
    each = (10 + (excitation == "multisine")) * SAMPLES / RATE  # with a period to let go by
    assert more.sum() == int(12.0 / each)


def test_the_journal_keeps_sums_and_no_samples(composed, tmp_path):
    scanned(composed, tmp_path, "scan.sampling.records=50")
    path = tmp_path / "a" / "image_000.npz"
    dac, _, sums = read_line(path)
    assert isinstance(sums, ResponseSums)
    lines = sums.sxx.shape[1]
    assert path.stat().st_size < 32 * len(dac) * lines + 8 * lines + 4096
    path.write_bytes(path.read_bytes()[:-200])
    assert read_line(path) is None


@pytest.mark.whole
def test_averages_are_replayed_to_the_bit(composed, tmp_path):
    first, _ = scanned(composed, tmp_path / "run" / "journal", "scan.sampling.spare=6.0")
    replay = ("instrument=replay", f"instrument.path={tmp_path / 'run'}", "scan.sampling.spare=6.0")
    again, _ = scanned(composed, tmp_path / "again", *replay)
    same(first, again)
    with pytest.raises(Exception, match="the scan's sampling must say the same"):
        scanned(composed, tmp_path / "other", *replay, "scan.sampling.records=9")


def test_where_no_light_comes_back_nothing_is_taken_again(composed, tmp_path):
    dark = ("scene.backdrop=false", "scan.views={a: {corners: [[-640, 130], [-640, -2400], "
            "[640, -2400], [640, 130]]}}", "scene.vibrometer.drop_out=0")  # fmt: skip
    image, _ = scanned(composed, tmp_path, *dark)
    lost = image["flags"].values != 0
    assert 0 < lost.sum() < lost.size
    np.testing.assert_array_equal(image["left_out"].sel(fault="dropped_out")[lost], 10)


def test_the_worst_coherence_comes_first_and_time_ends():
    rng = np.random.default_rng(5)
    x = rng.standard_normal((6, 20, 3, 2)) @ [1, 1j]
    noise = np.array([0.1, 1.0, 0.3, 0.7, 100.0, 2.0])[:, None, None]
    sums = ResponseSums.zeros(6, [50.0, 60.0, 70.0])
    sums.add(x, x + noise * (rng.standard_normal((*x.shape, 2)) @ [1, 1j]))
    assert worst_first(sums).tolist() == [5, 1, 3, 2, 0, 4]  # where nothing moves is the last
    dac = np.arange(12).reshape(6, 2)
    ((pixels, where),) = once_more(sums, dac, seconds=2.0, spare=5.0)
    assert pixels.tolist() == [5, 1]
    assert where.tolist() == [[10, 11], [2, 3]]
    assert list(once_more(sums, dac, seconds=2.0, spare=1.9)) == []
    more = ResponseSums.zeros(2, sums.frequency)
    more.add(x[:2], x[:2])
    twice = added(sums, more, np.array([1, 4]))
    assert twice.count.tolist() == [20, 40, 20, 20, 40, 20]
    np.testing.assert_array_equal(twice.syy[4], sums.syy[4] + more.syy[1])


class Spoilt:
    """An instrument that gives other records than it was asked for."""

    def __init__(self, records=0, samples=0, rate=1.0):
        self.records, self.samples, self.rate = records, samples, rate

    def configure(self, acquisition):
        self.asked = acquisition

    def scan(self, dac, stream=None):
        a = self.asked
        shape = (len(dac) * a.records + self.records, 2, a.samples + self.samples)
        return RawSamples(np.ones(shape, np.int16), np.ones(2), a.rate * self.rate,
                          np.zeros(shape[0], np.uint8), a.records)  # fmt: skip


def test_what_the_instrument_says_of_a_record_is_what_is_wrong_with_it():
    acquisition = acquisition_of(Sampling(RATE, SAMPLES, excitation=ExcitationKind.chirp))
    played = (1000 * acquisition.drive.waveform()).astype(np.int16)
    told = np.array([[1, 0, 2, 4] + 6 * [0], 10 * [0]], np.uint8)
    noise = np.random.default_rng(1).integers(-50, 50, (20, 2, SAMPLES)).astype(np.int16)

    def scan(dac, stream=None):
        return RawSamples(noise + played, np.full(2, 1e-3), RATE, told.ravel(), 10)

    instrument = SimpleNamespace(scan=scan, configure=lambda acquisition: None)
    sums = Averaging(Response(), acquisition, 0).measure(instrument, np.zeros((2, 2), int), 0)
    names = [fault.name for fault in RecordFault]
    assert dict(zip(names, sums.left_out[0].tolist(), strict=True)) == {
        "saturated": 1,
        "dropped_out": 1,
        "reference_missing": 1,
        "non_finite": 0,
        "double_hit": 0,
    }
    assert sums.count.tolist() == [7, 10]


@pytest.mark.parametrize(
    ("fault", "told"),
    [
        ({"records": -1}, r"30 records were asked for and 29 came: triggers were missed"),
        ({"samples": 5}, r"records of 512 samples were asked for and have 517; all must have the"),
        ({"rate": 1.01}, r"samples at 5171.2 Hz, not at 5120 Hz, so that no line of a record is"),
    ],
)
def test_records_that_are_not_as_asked_for_are_refused(fault, told):
    sampling = Sampling(RATE, SAMPLES, excitation=ExcitationKind.chirp)
    acquisition = acquisition_of(sampling)
    instrument = Spoilt(**fault)
    instrument.configure(acquisition)
    with pytest.raises(UserError, match=told):
        Averaging(Response(), acquisition, 0).measure(instrument, np.zeros((3, 2), int), 0)


@pytest.mark.one_in(6)
@pytest.mark.parametrize(
    ("change", "told"),
    [
        ("signal=sine_fit", "scan.sampling.excitation=multisine needs signal=response"),
        ("scene.digitizer.reference_gain=0", "the reference channel has no signal; the generator"),
        ("scene.digitizer.reference_range=0.5", "records are over range; choose a larger range"),
        ("scene.shutter_open=false", "no light comes back; the laser's shutter is closed"),
        ("scan.sampling.band=[51.0,54.0]", "no line of a record of 0.1 s"),
    ],
)
def test_what_averages_cannot_be_made_of_is_told(composed, tmp_path, change, told):
    with pytest.raises(Exception, match=told):
        scanned(composed, tmp_path, change)


@pytest.mark.whole
def test_noise_in_short_records_is_warned_of(composed, tmp_path):
    """Lines and the record length that would do; what repeats needs no warning."""
    _, findings = scanned(composed, tmp_path, "scan.sampling.excitation=random")
    leak = next(f for f in findings if "leak" in f.text)
    assert leak.severity.name == "void"
    assert "Hz" in leak.text
    assert "take records of" in leak.text
    _, findings = scanned(composed, tmp_path / "periodic", "scene.vibrometer.drop_out=0")
    assert findings == []


class Skips(Watcher):
    """Scans the second line twice, and leaves the view out after the third."""

    def __init__(self):
        self.lines, self.again = [], (2,)

    def line_done(self, line):
        self.lines.append(line)

    def between_lines(self, view, lines, done, count):
        again, self.again = (self.again, ()) if done == 2 else ((), self.again)
        return Wish(again=again, skip=done == 3)


def test_who_watches_sees_averages_line_by_line(composed, tmp_path):
    watcher = Skips()
    made = composed(*AVERAGES, "scan.sampling.spare=100", "scene.vibrometer.drop_out=0")
    found = scan_views(made, tmp_path, watcher=watcher)
    image = found["image/a"]
    assert image.sizes["pixel"] == 3 * 6
    assert (image["records"] == 10).all()  # what is left out needs no pixel measured once more
    assert [line.number for line in watcher.lines] == [1, 2, 2, 3]
    again, last = watcher.lines[2:]
    np.testing.assert_array_equal(again.image.velocity, image["velocity"].values[6:12])
    assert (watcher.lines[1].image.velocity != again.image.velocity).all()
    velocity, reference = last.level
    assert reference == pytest.approx(1.0, rel=0.01)  # V, r.m.s.
    truth = np.sqrt((np.abs(last.image.velocity) ** 2).sum() / 2 / 6)
    assert velocity == pytest.approx(100 * truth, rel=0.1)


@pytest.mark.long
def test_memory_does_not_grow_with_records():
    """2,000 pixels, 256 lines, 50 records: at most 100 MB above the base."""
    import tracemalloc

    sampling = Sampling(RATE, 1024, excitation=ExcitationKind.multisine, band=[50.0, 1325.0],
                        records=50)  # fmt: skip
    acquisition = acquisition_of(sampling)
    noise = np.random.default_rng(0).integers(-9, 9, (100, 2, 1024)).astype(np.int16)
    played = (1000 * acquisition.drive.waveform()).astype(np.int16)

    def scan(dac, stream=None):
        rows = np.arange(len(dac) * acquisition.records) % len(noise)
        volts = np.array([1e-3, 1e-3])
        return RawSamples(noise[rows] + played, volts, RATE, np.zeros(len(rows), np.uint8), 50)

    instrument = SimpleNamespace(scan=scan, configure=lambda acquisition: None)
    averages = Averaging(Response(), replace(acquisition), 0)
    tracemalloc.start()
    sums = averages.measure(instrument, np.zeros((2000, 2), int), 0)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert sums.count.tolist() == [50] * 2000
    assert peak < 100e6
