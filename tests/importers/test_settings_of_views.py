"""Files of one session may differ: each view is asked for what its own file leaves open."""

from __future__ import annotations

import dataclasses
import re

import numpy as np
import pytest

from sldvexp.dataset import take_findings
from sldvexp.errors import ConfigError, UserError
from sldvexp.importers import PointwiseImport, PointwiseView, conventions
from sldvexp.importers.questions import OF_VIEW
from sldvexp.importers.scan_export import ScanExport
from sldvexp.importers.uff import UffImport
from sldvexp.units import LengthUnit

from .plate_files import FIRST, POINTS, SAID, SIX_DIGITS

#: What no text table says.
SENSES = {
    "directions": conventions.Directions.view,
    "positive": conventions.Positive.towards,
    "phase": conventions.Phase.exp_plus,
}
VALUES = np.array([1 + 2j, -3 + 0.5j, 0.25 - 4j, -5 - 6j])  # mm/s peak
#: Headings of values, and the number that a file has where the velocity is 1 mm/s peak.
HEADINGS = {
    "peak": ("mm/s", 1.0),
    "rms": ("m/s rms", 1e-3 / 2**0.5),
    "none": ("", 1e-3 / 2**0.5),
}
ANSWER = re.compile(r"(?:for example|as with) (instrument\.\S+?)(?:;|$)")


def table(unit, factor, length="mm", rows=(0, 1, 2, 3)):
    """A text table of four points of a plate, in a unit of coordinates and one of values."""
    scale = LengthUnit[length].value if length else 1.0
    head = f"n\tX [{length}]\tY [{length}]\tZ [{length}]\tRe [{unit}]\tIm [{unit}]\n"
    if not length:
        head = f"n\tX\tY\tZ\tRe [{unit}]\tIm [{unit}]\n"
    lines = [
        "\t".join(
            f"{x:.12g}"
            for x in (
                i + 1,
                *(np.array(POINTS[i]) / scale),
                factor * VALUES[i].real,
                factor * VALUES[i].imag,
            )
        )
        for i in rows
    ]
    return "Frequency: 197 Hz\n" + head + "\n".join(lines) + "\n"


def views_of(tmp_path, texts, suffix="txt"):
    views = {}
    for k, (name, text) in enumerate(texts.items()):
        path = tmp_path / f"{name}.{suffix}"
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        views[name] = PointwiseView(path=str(path), direction=[0.1 * k, 0.0, 1.0])
    return views


def asked(cls, views, **settings):
    with pytest.raises(UserError) as error:
        cls(views=views, **settings).read()
    assert "\n" not in str(error.value)
    return str(error.value)


def with_own(views, name, **own):
    return views | {name: dataclasses.replace(views[name], **own)}


def right(group, values=1e-3 * VALUES):
    np.testing.assert_allclose(group["velocity"][:, :, 0], [values] * group.sizes["view"])
    np.testing.assert_allclose(group["position"], np.array(POINTS)[: len(values)], atol=1e-12)


def test_settings_of_a_view_are_those_that_it_shares_with_the_instrument():
    shared = {f.name for f in dataclasses.fields(PointwiseView)}
    assert shared & {f.name for f in dataclasses.fields(PointwiseImport)} == set(OF_VIEW)


def test_peak_and_rms_in_two_units_are_read_right_in_one_session(tmp_path):
    texts = {"a": table("mm/s", 1.0), "b": table("m/s rms", 1e-3 / 2**0.5)}
    texts["c"] = table("m/s", 1e-3 / 2**0.5, length="m")
    views = views_of(tmp_path, texts)
    said = asked(ScanExport, with_own(views, "a", amplitude=conventions.Amplitude.peak), **SENSES)
    assert "say it with instrument.views.c.amplitude, for example" in said
    views = with_own(views, "a", amplitude=conventions.Amplitude.peak)
    views = with_own(views, "c", amplitude=conventions.Amplitude.rms)
    group = ScanExport(views=views, **SENSES).read()
    right(group)
    assert not take_findings({"line_of_sight": group})
    assert group.attrs["import_amplitude"] == "peak; rms by m/s rms; rms"


def test_setting_of_one_view_is_asked_for_where_files_of_others_say_it(tmp_path):
    texts = {"a": table("mm/s pk", 1.0), "b": table("m/s", 1e-3 / 2**0.5), "c": table("um/s", 1e3)}
    views = views_of(tmp_path, texts)
    said = asked(ScanExport, views, **SENSES)
    assert said.endswith(
        "say it with instrument.views.b.amplitude, for example instrument.views.b.amplitude=peak "
        "(and likewise of c)"
    )
    # The same said of all would be wrong of the first, and a run doubtful.
    whole = ScanExport(views=views, **SENSES, amplitude=conventions.Amplitude.rms).read()
    assert [f.severity.name for f in take_findings({"line_of_sight": whole})] == ["doubtful"]
    views = with_own(views, "b", amplitude=conventions.Amplitude.rms)
    views = with_own(views, "c", amplitude=conventions.Amplitude.peak)
    group = ScanExport(views=views, **SENSES).read()
    right(group)
    assert not take_findings({"line_of_sight": group})


def test_what_all_views_need_is_asked_of_all_with_the_way_for_each(tmp_path):
    views = views_of(tmp_path, {"a": table("mm/s", 1.0), "b": table("mm/s", 1.0)})
    said = asked(ScanExport, views, **SENSES)
    assert "say it with instrument.amplitude, for example instrument.amplitude=peak" in said
    assert said.endswith("where views differ, say it of each, as with instrument.views.a.amplitude")
    right(ScanExport(views=views, **SENSES, amplitude=conventions.Amplitude.peak).read())
    said = asked(ScanExport, {"a": views["a"]}, **SENSES)
    assert "instrument.views" not in said


def test_setting_of_a_view_that_contradicts_its_file_is_doubtful_by_its_name(tmp_path):
    views = views_of(tmp_path, {"a": table("mm/s pk", 1.0), "b": table("mm/s pk", 1.0)})
    views = with_own(views, "b", amplitude=conventions.Amplitude.rms)
    group = ScanExport(views=views, **SENSES).read()
    (finding,) = take_findings({"line_of_sight": group})
    assert "instrument.views.b.amplitude=rms wins, although the file says mm/s pk" in finding.text
    np.testing.assert_allclose(group["velocity"][1], 2**0.5 * group["velocity"][0])


def spectrum(uff, factor, unit="", units=b"", nodes=1.0):
    return (
        units
        + uff.nodes(np.array(POINTS) / nodes)
        + uff.function(1, factor * FIRST, kind=12, unit=unit)
    )


def test_universal_files_of_different_kinds_are_read_right_in_one_session(uff, tmp_path):
    inch = 0.0254
    contents = {
        "a": spectrum(uff, 1e3, "mm/s rms", uff.units()),
        "b": spectrum(uff, 1 / inch, "", b"", inch),
    }
    views = views_of(tmp_path, contents, "uff")
    said = asked(UffImport, views, **SAID)
    assert said.startswith("3 questions are open: ")
    for setting in ("length_unit", "unit", "amplitude"):
        assert f"say it with instrument.views.b.{setting}" in said
    own = {"length_unit": LengthUnit.inch, "unit": conventions.MotionUnit.inch}
    views = with_own(views, "b", **own, amplitude=conventions.Amplitude.peak)
    group = UffImport(views=views, **SAID).read()
    np.testing.assert_allclose(group["velocity"][:, 0], [2**0.5 * FIRST, FIRST], rtol=SIX_DIGITS)
    np.testing.assert_allclose(group["position"], POINTS[:1], atol=1e-6)
    assert {f.severity.name for f in take_findings({"line_of_sight": group})} <= {"note"}


def test_views_have_references_of_their_own(uff, tmp_path):
    contents = {
        name: uff.units() + uff.nodes(POINTS) + uff.function(1, FIRST / factor, reference_unit=unit)
        for name, unit, factor in (("a", "N", 2.0), ("b", "V", 0.5), ("c", "N", 3.0))
    }
    views = views_of(tmp_path, contents, "uff")
    said = asked(UffImport, views, **SAID | {"reference": "2 N"})
    assert "a reference in V, a voltage, but the one that is set is in N" in said
    assert said.endswith("in units of the file's with instrument.views.b.reference")
    said = asked(UffImport, views, **SAID | {"reference": 2})
    assert said.endswith("for itself, for example instrument.views.b.reference='2 V'")
    views = with_own(views, "b", reference="500 mV")
    views = with_own(views, "c", reference="3")
    group = UffImport(views=views, **SAID | {"reference": "2 N"}).read()
    np.testing.assert_allclose(group["velocity"][:, 0], [FIRST] * 3, rtol=SIX_DIGITS)
    assert not take_findings({"line_of_sight": group})
    with pytest.raises(ConfigError, match=r"views\.c\.reference"):
        UffImport(views=with_own(views, "c", reference="-3 N"), **SAID)


def test_contradiction_within_one_file_is_answered_by_its_view(uff, tmp_path):
    contents = {
        "a": uff.units() + uff.nodes(POINTS) + uff.function(1, FIRST),
        "b": uff.units() + uff.nodes(POINTS) + uff.function(1, FIRST, quantity=8, unit="m/s"),
    }
    views = views_of(tmp_path, contents, "uff")
    said = asked(UffImport, views, **SAID)
    assert said.endswith("say which with instrument.views.b.quantity")
    views = with_own(views, "b", quantity=conventions.Quantity.velocity)
    group = UffImport(views=views, **SAID).read()
    np.testing.assert_allclose(group["velocity"][:, 0], [FIRST] * 2, rtol=SIX_DIGITS)
    (finding,) = take_findings({"line_of_sight": group})
    assert "instrument.views.b.quantity=velocity wins" in finding.text


@pytest.mark.one_in(2)
@pytest.mark.parametrize("name", ["left", "left side"])
def test_answer_as_it_is_proposed_is_right_on_the_command_line(tmp_path, sldvexp, name):
    texts = {"front": table("mm/s pk", 1.0), name: table("m/s", 1e-3), "below": table("mm/s pk", 1)}
    views = views_of(tmp_path, texts)
    settings = [
        "instrument.directions=view",
        "instrument.positive=towards",
        "instrument.phase=exp_plus",
        "instrument.std=1e-6",
        "reconstruction=absolute",
    ]
    for k, (own, view) in enumerate(views.items()):
        direction = [[0, 0, 1], [0, 0.6, 0.8], [0.6, 0, 0.8]][k]
        settings.append(
            f"instrument.views={{'{own}': {{path: '{view.path}', direction: {direction}}}}}"
        )
    arguments = ["~experiment", "instrument=scan_export", *settings]
    done = sldvexp(*arguments)
    assert done.status == 1, done.out
    (answer,) = re.findall(r"for example (instrument\..+)$", done.err.strip())
    done = sldvexp(*arguments, answer)
    assert done.status == 0, done.err
    np.testing.assert_allclose(done.tree["line_of_sight"]["velocity"][:, :, 0], [1e-3 * VALUES] * 3)


def test_quantity_that_another_function_contradicts_is_answered_by_its_view(uff, tmp_path):
    """The displacement of the same motion bears witness."""
    omega = 2j * np.pi * (100.0 + 10 * np.arange(5))
    lines = {"first": 100.0, "step": 10.0}
    both = uff.function(1, FIRST, unit="m/s", **lines)
    both += uff.function(1, FIRST / omega, unit="m", quantity=8, **lines)
    contents = dict.fromkeys("ab", uff.units() + uff.nodes(POINTS) + both)
    views = views_of(tmp_path, contents, "uff")
    wrong = with_own(views, "b", quantity=conventions.Quantity.acceleration)
    said = asked(UffImport, wrong, **SAID)
    assert "do not fit instrument.views.b.quantity=acceleration" in said
    assert said.endswith("they fit instrument.views.b.quantity=velocity")
    group = UffImport(views=views, **SAID).read()
    np.testing.assert_allclose(group["velocity"][:, 0], [FIRST] * 2, rtol=SIX_DIGITS)


def test_frequency_of_zero_raises_no_question_of_frequencies(uff, tmp_path):
    """Accelerations have no velocity at 0 Hz, which is left out of them alone."""
    first = {"first": 0.0, "step": 10.0}
    contents = {
        "a": uff.units()
        + uff.nodes(POINTS)
        + uff.function(1, FIRST, quantity=12, unit="m/s^2", **first),
        "b": uff.units()
        + uff.nodes(POINTS)
        + uff.function(1, FIRST, quantity=12, unit="EU", **first),
    }
    views = views_of(tmp_path, contents, "uff")
    said = asked(UffImport, views, **SAID)
    assert "questions" not in said
    assert "say it with instrument.views.b.unit" in said
    views = with_own(views, "b", unit=conventions.MotionUnit.m)
    group = UffImport(views=views, **SAID).read()
    expected = FIRST[1:] / (2j * np.pi * 10.0 * np.arange(1, 5))
    np.testing.assert_allclose(group["velocity"][:, 0], [expected] * 2, rtol=SIX_DIGITS)


def test_origin_in_another_unit_is_doubtful_by_its_view(tmp_path):
    """An instrument 1000 m from a plate of 0.3 m is one whose origin was given in mm."""
    views = views_of(tmp_path, dict.fromkeys("ab", table("mm/s pk", 1.0)))
    views = with_own(views, "a", direction=[], origin=[0.1, 0.2, 1.2])
    views = with_own(views, "b", direction=[], origin=[-300.0, 200.0, 1200.0])
    (found,) = take_findings({"line_of_sight": ScanExport(views=views, **SENSES).read()})
    assert (found.kind, found.subject, found.severity.name) == ("origin", "view b", "doubtful")
    assert "instrument.views.b.origin is in m" in found.text
