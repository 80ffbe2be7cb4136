"""From a universal file of two shakers to two modes of one frequency, by the command."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from sldvexp.dataset.references import further_references
from sldvexp.importers.image_file import Images
from sldvexp.io.uff import universal_file
from sldvexp.modes import MostLikelyModes, estimate_modes

DATA = Path(__file__).parents[2] / "conf" / "data"
ORIGINS = {"front": (0.1, 0.0, 1.5), "left": (-0.9, -0.2, 1.1), "below": (0.3, -0.9, 1.1)}
LINE = np.arange(100.0, 202.0, 2.0)
#: Natural frequency, Hz, and damping of two modes; the part of each in two references.
NATURAL, DAMPING = 150.0, 0.02
PART = np.array([[1.0, 0.5], [0.4, -1.0]])
NOISE = 2e-6


@pytest.fixture
def shaken(uff, tmp_path):
    """Universal files of the tutorial's panel, with two references each; their settings."""
    rng, settings = np.random.default_rng(3), []
    r = LINE / NATURAL
    resonance = 2j * DAMPING * r / (1 - r**2 + 2j * DAMPING * r)
    for view, origin in ORIGINS.items():
        source = DATA / "tutorial_front.uff"
        with universal_file(source) as file:
            place = np.asarray(file.geometry.position) * 1e-3
        look = np.array(origin) - place
        look /= np.linalg.norm(look, axis=1, keepdims=True)
        x, y, _ = place.T
        shapes = 1e-3 * np.stack([np.cos(np.pi * x / 0.3), 60 * x * y]) * look[:, 2]
        content = source.read_bytes().split(b"    -1\n    58\n")[0]
        for reference, part in zip((1, 2), PART, strict=True):
            seen = np.outer(part @ shapes, resonance)
            seen = seen + NOISE * (rng.normal(size=seen.shape) + 1j * rng.normal(size=seen.shape))
            content += b"".join(
                uff.function(n + 1, row, first=LINE[0], step=2.0, reference=(reference, 3))
                for n, row in enumerate(seen)
            )
        path = tmp_path / f"{view}.uff"
        path.write_bytes(content)
        settings.append(f"instrument.views.{view}.path={path}")
    return [
        *("experiment=tutorial", "modal=own", "report=none", "~expect.consistent"),
        *(f"instrument.std={NOISE}", "instrument.reference=1.0", "instrument.frequency=[]"),
        *("instrument.unit=m", *settings),
    ]


@pytest.mark.whole
def test_two_references_of_a_universal_file_tell_two_modes_of_one_frequency(sldvexp, shaken):
    done = sldvexp(*shaken, "instrument.reference_dof=1+Z", "instrument.further_references=[2+Z]")
    assert done.status == 0, done.err
    found = done.tree["modes"]
    assert found["natural_frequency"].values == pytest.approx([NATURAL, NATURAL], rel=1e-4)
    for name, true in (("natural_frequency", NATURAL), ("damping_ratio", DAMPING)):
        assert np.abs((found[name].values - true) / found[f"{name}_std"].values).max() < 3
        assert found[f"{name}_std"].values.max() < 1e-3 * true * (1 if true > 1 else 10)
    assert found["exciter"].values.tolist() == ["1+Z", "2+Z"]
    assert set(done.tree["reference"].children) == {"2+Z"}
    assert set(done.tree["reference/2+Z"].children) == set(ORIGINS)
    assert done.tree["modes/field"].sizes["frequency"] == 2
    shown = " ".join(sldvexp("show", str(done.folder)).out.split())
    assert "2 modes share the pole at 150 Hz" in shown
    assert "Of the references 1+Z, 2+Z together" in shown
    kept = Images(path=str(done.folder)).images()
    one = {k.removeprefix("image/"): v for k, v in kept.items() if k.startswith("image/")}
    again = estimate_modes(one, MostLikelyModes(), further_references(kept)).modes
    assert again["exciter"].values.tolist() == ["1+Z", "2+Z"]
    assert np.array_equal(again["natural_frequency"], found["natural_frequency"])


@pytest.mark.whole
def test_one_reference_of_it_is_asked_for_and_says_what_it_cannot_tell(sldvexp, shaken):
    done = sldvexp(*shaken)
    assert done.status == 1
    assert "choose one of 1+Z, 2+Z with instrument.reference_dof=1+Z, and for modes" in done.err
    done = sldvexp(*shaken, "instrument.reference_dof=1+Z")
    assert done.status == 0, done.err
    assert done.tree["modes"].sizes["mode"] == 1
    shown = " ".join(sldvexp("show", str(done.folder)).out.split())
    assert "two modes of one frequency and damping would be one here" in shown


@pytest.mark.one_in(3)
@pytest.mark.parametrize(
    ("settings", "said"),
    [
        (["instrument.further_references=[2+Z]"], "needs reference_dof besides, as 1+Z"),
        (
            ["instrument.reference_dof=2+Z", "instrument.further_references=[2+Z]"],
            "and each reference once",
        ),
        (
            ["instrument.reference_dof=1+Z", "instrument.further_references=[3+Z]"],
            "has no functions of the reference 3+Z",
        ),
    ],
)
def test_references_that_cannot_be_are_refused_by_one_sentence(sldvexp, shaken, settings, said):
    done = sldvexp(*shaken, *settings)
    assert done.status == 1
    assert said in done.err
    assert done.err.count("\n") == 1


def test_points_without_a_volume_are_of_one_reference(sldvexp, shaken):
    paths = [setting for setting in shaken if ".path=" in setting]
    done = sldvexp(
        *("experiment=tutorial_points", "report=none", *paths),
        *("instrument.reference_dof=1+Z", "instrument.further_references=[2+Z]"),
    )
    assert done.status == 1
    assert "modes of several need a volume, whose pixels the points become" in done.err
