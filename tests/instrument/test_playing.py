"""Instruments that play anything but sines, and take several records a pixel."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sldvexp.instrument import Acquisition, InstrumentError
from sldvexp.instrument.visa import Visa
from sldvexp.signal import Excitation, ExcitationKind, LineChoice
from sldvexp.virtual_lab import LabServer

pytestmark = pytest.mark.usefixtures("client_clock")

CONF = Path(__file__).parents[2] / "conf"
SOURCE = (CONF / "profile" / "virtual_lab.yaml").read_text()


def acquisition(kind, rate=5120.0, samples=512, records=3, **played):
    band = [0.02 * rate, 0.2 * rate]
    design = Excitation(ExcitationKind[kind], band, **played).design(rate, samples)
    return Acquisition(rate, samples, (), played.get("amplitude", 1.0), design, records, 1)


@pytest.mark.one_in(6)
@pytest.mark.parametrize(
    ("kind", "played"),
    [
        ("multisine", {"lines": LineChoice.sparse, "seed": 3}),
        ("chirp", {"amplitude": 0.5}),
        ("pseudo_random", {"seed": 4}),
        ("burst_random", {"burst": 0.25}),
        ("random", {"seed": 5}),
        ("hammer", {"amplitude": 3.0}),
    ],
)
def test_the_labs_server_measures_what_the_lab_does(lab, same, line, kind, played):
    chosen = ("scene=plate", "scene.vibrometer.drop_out=0.2")
    how, tones = acquisition(kind, **played), Acquisition(10000.0, 64, (450.0,))
    reference = lab(*chosen)
    wanted = []
    for one in (how, tones, replace(how, records=2)):
        reference.configure(one)
        wanted.append(reference.scan(line, stream=3))
    with LabServer(lab(*chosen)) as server, Visa(server.resource).open() as ours:
        for one, found in zip((how, tones, replace(how, records=2)), wanted, strict=True):
            ours.configure(one)
            again = ours.scan(line, stream=3)
            assert same(again, found)
            assert again.records == found.records == one.records
            assert len(again.status) == len(line) * one.records
        ours.configure(how)
        ours.move(line[0].tolist())
        assert len(ours.acquire().counts) == 3


def test_views_of_circles_by_a_sine_and_a_structure_by_records(lab, same, line):
    """Each view over a connection of its own, to a lab that stays as the last one left it."""
    chosen = ("scene=plate",)
    first = next(iter(lab(*chosen).scene.views))
    parts = (Acquisition(10000.0, 64, (450.0,)), acquisition("multisine", records=4))
    with LabServer(lab(*chosen)) as server:
        for stream in (3, 5):
            reference = lab(*chosen)
            with Visa(server.resource).open(view=first) as ours:
                for one in parts:
                    for instrument in (reference, ours):
                        instrument.configure(one)
                    assert same(ours.scan(line, stream=stream), reference.scan(line, stream=stream))


def test_all_is_sent_anew_after_a_setting_was_refused(lab, monkeypatch):
    """Although what was wished last is wished again."""
    how = acquisition("chirp")
    with LabServer(lab()) as server, Visa(server.resource).open() as ours:
        with monkeypatch.context() as patch:
            patch.delitem(server.dialect._commands, "GEN:BAND")
            with pytest.raises(InstrumentError, match="GEN:BAND"):
                ours.configure(how)
        ours.configure(how)
        assert server.dialect.playing
        assert server.dialect._wanted.drive.excitation == how.drive.excitation


def test_the_lab_takes_records_of_sines_too(lab, line):
    """Each at a phase of its own, all of a pixel before those of the next."""
    ours = lab()
    ours.configure(Acquisition(10000.0, 64, (450.0,), records=4))
    found = ours.scan(line)
    assert (len(found.counts), found.records) == (4 * len(line), 4)
    ours.configure(Acquisition(10000.0, 64, (450.0,)))
    again = ours.scan(np.repeat(line, 4, axis=0), stream=0)
    assert np.array_equal(again.counts, found.counts)


def changed(tmp_path, **texts):
    """The lab's profile with other commands."""
    source, begin = SOURCE, SOURCE.index("  play:")
    end = SOURCE.index("  records:")
    if "play" in texts:
        source = source[:begin] + texts["play"] + source[end:]
    source = source.replace("  chirp: CHIR\n", texts.get("chirp", "  chirp: CHIR\n"))
    (tmp_path / "mine.yaml").write_text(source)
    return str(tmp_path / "mine.yaml")


WAVEFORM = '  play: {lab: ["GEN:WAV {waveform}", "GEN:OUTP 1"]}\n'


@pytest.mark.parametrize(
    ("texts", "kind", "told"),
    [
        ({"play": ""}, "chirp", "cannot play chirp: its profile has no commands.play; give them,"),
        (
            {"chirp": ""},
            "chirp",
            "cannot play chirp: its profile has no functions.chirp; it has mu",
        ),
        ({"play": WAVEFORM}, "random", "over and over, which random noise is not; choose .*pseudo"),
    ],
)
def test_what_a_profile_cannot_play_is_told_before_anything_is_sent(
    lab, tmp_path, texts, kind, told
):
    profile = changed(tmp_path, **texts)
    with LabServer(lab()) as server, Visa(server.resource, profile=profile).open() as ours:
        with pytest.raises(InstrumentError, match=told):
            ours.configure(acquisition(kind))
        assert not server.dialect.playing


def test_a_waveform_of_one_record_is_sent(lab, tmp_path, monkeypatch):
    heard = []
    with LabServer(lab()) as server:
        monkeypatch.setitem(server.dialect._commands, "GEN:WAV", heard.append)
        profile = changed(tmp_path, play=WAVEFORM)
        how = acquisition("pseudo_random")
        with Visa(server.resource, profile=profile).open() as ours:
            ours.configure(how)
    volts = np.array(heard[0].split(","), float)
    np.testing.assert_allclose(volts, how.drive.waveform(), rtol=1e-5, atol=1e-6)


def test_what_is_played_goes_on_where_only_records_are_taken_again(lab, monkeypatch):
    """The generator is not started anew, so that the structure's motion goes on as it was."""
    heard, how = [], acquisition("chirp")
    with LabServer(lab()) as server:
        answer = server.dialect.answer
        monkeypatch.setattr(
            server.dialect, "answer", lambda text: heard.append(text) or answer(text)
        )
        with Visa(server.resource).open() as ours:
            ours.configure(how)
            heard.clear()
            ours.configure(replace(how, records=1))
            assert [text for text in heard if "?" not in text] == ["SAMP:REC 1,1,generator"]
            assert server.dialect.lab._acquisition.records == 1


def test_a_sine_is_what_a_quick_look_plays():
    from sldvexp.instrument.bench import quick

    look = quick(acquisition("chirp"))
    assert look.drive is None
    assert look.records == 1
    assert look.excitation == pytest.approx((np.sqrt(0.02 * 0.2) * 5120.0,))
