"""Kept sums of records obey every setting, or say that they cannot: by a measurement anew."""

from __future__ import annotations

import logging
from dataclasses import fields, replace

import numpy as np
import pytest

from sldvexp.config.paths import CONFIGURATION
from sldvexp.errors import UserError
from sldvexp.instrument import InstrumentError
from sldvexp.instrument.recording import read_line
from sldvexp.io.arrays import write_arrays
from sldvexp.scan import Sampling
from sldvexp.session.session import scan_views
from sldvexp.signal import FlagRules, Response, ResponseSums, SumsSettings

CORNERS = "[[-630, 130], [-630, -1400], [640, -1400], [640, 130]]"
#: A small scan of averages in the view a, some of whose records lose their light.
AVERAGES = {
    "scan": "rectangle",
    "scan.views": f"{{a: {{corners: {CORNERS}}}}}",
    "scan.pixels": "[3,4]",
    "signal": "response",
    "scan.sampling.rate": "5120",
    "scan.sampling.samples": "512",
    "scan.sampling.excitation": "multisine",
    "scan.sampling.band": "[50.0,1325.0]",
    "scan.sampling.spare": "3",
    "scene.digitizer.reference_range": "10",
    "scene.vibrometer.drop_out": "0.2",
}
HAMMER = {"scan.sampling.excitation": "hammer", "scan.sampling.decay": "0.03"}
RANDOM = {"scan.sampling.excitation": "random"}
BURST = {"scan.sampling.excitation": "burst_random"}
#: Another value of every setting, and what must be so that it has a meaning.
OTHERWISE: dict[str, tuple[str, dict[str, str]]] = {
    "signal.velocity_per_volt": ("-0.025", {}),
    "signal.harmonics": ("1", {}),
    "signal.incremental": ("true", {"signal.harmonics": "1"}),
    "signal.hum": ("[50.0]", {}),
    "signal.intercept": ("never", {}),
    "signal.confidence": ("0.9", {}),
    "signal.refine": ("true", {}),
    "signal.search": ("1.0", {"signal.refine": "true"}),
    "signal.flags.dropout_factor": ("1.05", {}),
    "signal.flags.reference_minimum": ("2.5", {}),
    "signal.flags.reference_snr": ("50", {}),
    "signal.flags.poor_fit": ("0.01", {}),
    "signal.estimator": ("h2", {}),
    "signal.noise_ratio": ("2.0", {"signal.estimator": "hv"}),
    "signal.mains": ("[]", {}),
    "scan.sampling.rate": ("5000", {}),
    "scan.sampling.samples": ("600", {}),
    "scan.sampling.frequency": ("[100.0]", {}),
    "scan.sampling.amplitude": ("0.5", {}),
    "scan.sampling.excitation": ("chirp", {}),
    "scan.sampling.band": ("[50.0,1000.0]", {}),
    "scan.sampling.lines": ("odd", {}),
    "scan.sampling.seed": ("7", RANDOM),
    "scan.sampling.burst": ("0.3", BURST),
    "scan.sampling.decay": ("0.05", HAMMER),
    "scan.sampling.force": ("0.01", HAMMER),
    "scan.sampling.overlap": ("true", RANDOM),
    "scan.sampling.records": ("9", {}),
    "scan.sampling.lead": ("2", {}),
    "scan.sampling.trigger": ("free", {}),
    "scan.sampling.again": ("0", {}),
    "scan.sampling.spare": ("1.2", {}),
}
#: Settings that sums cannot be freed of, as sentences name them.
FIXED = {
    "signal.flags.dropout_factor": ("signal.flags.dropout_factor", "5.0", "1.05"),
    "signal.flags.reference_minimum": ("signal.flags.reference_minimum", "0.1", "2.5"),
    "scan.sampling.force": ("sampling.force", "0.0", "0.01"),
    "scan.sampling.overlap": ("sampling.overlap", "False", "True"),
    "scan.sampling.again": ("sampling.again", "10", "0"),
}


def scanned(composed, folder, settings):
    return scan_views(composed(*(f"{k}={v}" for k, v in settings.items())), folder)["image/a"]


def replay_of(folder):
    return {"instrument": "replay", "instrument.path": str(folder)}


def alike(one, two):
    """To rounding, which a factor may leave."""
    assert set(one.data_vars) == set(two.data_vars)
    for name, values in one.data_vars.items():
        size = np.abs(two[name].values).max(initial=0)
        np.testing.assert_allclose(values, two[name], rtol=1e-9, atol=1e-12 * size, err_msg=name)


def test_every_setting_is_asked_for_otherwise():
    """So that one that is added later is tried, too."""
    flags = [f"signal.flags.{f.name}" for f in fields(FlagRules)]
    of_signal = [f"signal.{f.name}" for f in fields(Response) if f.name != "flags"]
    sampling = [f"scan.sampling.{f.name}" for f in fields(Sampling)]
    assert set(OTHERWISE) == {*flags, *of_signal, *sampling}
    assert {f.name for f in fields(SumsSettings)} == {
        "velocity_per_volt", *(key.rpartition(".")[2] for key in FIXED)
    }  # fmt: skip


@pytest.mark.whole
@pytest.mark.parametrize("setting", OTHERWISE)
def test_a_recording_is_as_a_measurement_anew_or_refuses(composed, tmp_path, setting):
    """With any setting asked for otherwise than when it was recorded."""
    value, needs = OTHERWISE[setting]
    recorded = AVERAGES | needs
    scanned(composed, tmp_path / "run" / "journal", recorded)
    asked = recorded | {setting: value}
    told, again = "", None
    try:
        again = scanned(composed, tmp_path / "again", asked | replay_of(tmp_path / "run"))
    except (UserError, InstrumentError) as error:
        told = str(error)
    if again is not None:
        alike(again, scanned(composed, tmp_path / "anew", asked))
    elif not setting.endswith(".spare"):  # whose lines were recorded as they are, or were not
        assert setting.removeprefix("scan.") in told
        assert "scan anew" in told


@pytest.mark.one_in(6)
@pytest.mark.parametrize("setting", FIXED)
@pytest.mark.parametrize(
    "resumed",
    [pytest.param(False, id="replay"), pytest.param(True, id="resume", marks=pytest.mark.whole)],
)
def test_what_sums_cannot_be_freed_of_is_named(composed, tmp_path, setting, resumed):
    value, needs = OTHERWISE[setting]
    recorded = AVERAGES | needs | {"scan.sampling.spare": "0"}
    scanned(composed, tmp_path / "run" / "journal", recorded)
    asked = recorded | {setting: value}
    (name, kept, other), folder = FIXED[setting], tmp_path / "run" / "journal"
    if resumed:  # a damaged digest says nothing of the lines
        (folder / CONFIGURATION).unlink()
    else:
        folder, asked = tmp_path / "again", asked | replay_of(tmp_path / "run")
    told = (
        f"its sums of records were made with {name}={kept}, not with {name}={other}, and the "
        f"records themselves are not kept: set {name}={kept} again, or scan anew"
    )
    with pytest.raises(UserError) as error:
        scanned(composed, folder, asked)
    assert told in str(error.value)
    assert str(tmp_path / "run") in str(error.value)


@pytest.mark.whole
def test_a_session_goes_on_with_another_factor_of_the_velocity(composed, tmp_path):
    """Lines that were kept and lines that are measured then are in one unit."""
    scanned(composed, tmp_path / "cut", AVERAGES)
    for path in sorted((tmp_path / "cut" / "a").glob("*.npz"))[1:]:
        path.unlink()
    asked = AVERAGES | {"signal.velocity_per_volt": "-0.025"}
    on = scanned(composed, tmp_path / "cut", asked)
    alike(on, scanned(composed, tmp_path / "anew", asked))
    first = read_line(tmp_path / "cut" / "a" / "image_000.npz")[2]
    assert first.made.velocity_per_volt == 0.01  # as it was measured


def test_sums_that_tell_no_settings_are_taken_for_those_of_the_run_and_it_says_so(
    composed, tmp_path, caplog
):
    settings = AVERAGES | {"scan.sampling.spare": "0"}
    whole = scanned(composed, tmp_path / "run" / "journal", settings)
    for path in (tmp_path / "run" / "journal" / "a").glob("*.npz"):
        with np.load(path) as kept:
            arrays = {name: kept[name] for name in kept if name != "made"}
        with path.open("wb") as file:
            write_arrays(file, **arrays)
    with caplog.at_level(logging.WARNING):
        again = scanned(composed, tmp_path / "again", settings | replay_of(tmp_path / "run"))
    alike(again, whole)
    told = [
        r.message for r in caplog.records if "does not say which velocity_per_volt" in r.message
    ]
    assert len(told) == 1
    assert "those of this run are taken for them" in told[0]


def test_settings_of_a_damaged_line_are_none(tmp_path, composed):
    scanned(composed, tmp_path, AVERAGES)
    path = tmp_path / "a" / "image_000.npz"
    with np.load(path) as kept:
        arrays = dict(kept) | {"made": np.ones(3)}
    with path.open("wb") as file:
        write_arrays(file, **arrays)
    assert read_line(path) is None


def test_sums_of_other_settings_are_not_joined():
    made = SumsSettings(0.01, 5.0, 0.1)
    one, two = (ResponseSums.zeros(1, [50.0], m) for m in (made, replace(made, force=0.1)))
    with pytest.raises(UserError, match="made with other settings"):
        one.merged(two)
    with pytest.raises(UserError, match="made with other settings"):
        ResponseSums.concatenated([one, two])
