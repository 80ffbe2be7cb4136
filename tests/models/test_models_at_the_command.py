"""The command accepts a right model; one of no use is refused before anything is measured."""

from __future__ import annotations

import pytest

from sldvexp.models import universal_text
from tests.models.made_models import closed_form

ELSEWHERE = "volume=grid volume.center=[0.42,0.14,0.0] volume.size=[0.26,0.21] volume.shape=[7,6]"

#: A session of three views, few pixels, and lines around two of the modes.
SMALL = [
    *(f"~scan.{part}.views.{view}" for part in ("calibration", "structure") for view in (4, 5)),
    *("scan.structure.pixels=[11,12]", "scan.calibration.fine.lines=16"),
    f"scan.structure.sampling.frequency={[float(f) for f in range(400, 605, 5)]}".replace(" ", ""),
    *("~expect.right_model", "~expect.modulus"),
]


@pytest.mark.whole
def test_right_model_is_accepted(sldvexp):
    done = sldvexp("experiment=plate_model", "report=none", *SMALL)
    assert done.status == 0, done.err
    assert "finite element model accepted (shapes accepted, frequencies accepted)" in done.out
    model = done.tree["model"]
    assert model["pair"].values.tolist() == [2, 3]
    assert min(float(model[f"{name}_p_value"]) for name in ("shapes", "frequencies")) > 1e-3
    assert abs(float(model["factor"].item()) - 1) < 4 * float(model["factor_std"].item())


@pytest.mark.one_in(7)
@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ("model.unit=mm", "states coordinates in units of 1 m, the configuration model.unit"),
        ("model.path=none.uff", "none.uff: there is no such file"),
        ("model.path=conf://data/tutorial_front.uff", "states coordinates in units of 0.001 m"),
        ("model.containing=nothing", "has nodes and elements but no mode shapes"),
        ("model.adjust={Young: 0.0}", "adjust.Young: no such parameter; Valid: E, nu, rho"),
        ("model.coarser=none.uff", "none.uff: there is no such file"),
        ("model.coarser=conf://data/plate_model.uff", "plate_model.uff: its elements are 1 times"),
        (
            "model.parameters.nu.sensitivity=[0.1,0.2]",
            "parameters.nu.sensitivity: has 2 numbers; give one, or one for each of the model's 6",
        ),
        (
            "model.drive={point: [0.0, 0.0, 0.0]}",
            "drive.point: the force acts beside the model: no surface lies along",
        ),
        ("model.parameters.E.value=0", "model.parameters.E.value must be a positive number"),
        ("model.frame.origin=[0.42]", "model.frame.origin must be 3 numbers, not 1"),
        ("~modal", "model: needs the modes of the structure to be tested; choose modal=own"),
        (f"model.frame.origin=[0.0,0.0,1.0] {ELSEWHERE}", "say where its axes stand"),
        (f"model.frame.euler=[0.0,1.5707963,0.0] {ELSEWHERE}", "the surface of the volume x from"),
    ],
)
def test_model_that_cannot_be_used_is_refused_at_once(sldvexp, settings, said):
    done = sldvexp("experiment=plate_model", "report=none", *_words(settings))
    assert done.status == 1
    assert said in done.err
    assert done.err.count("\n") == 1
    assert "view 1 of 5" not in done.out + done.err


def test_modes_twice_and_shapes_without_frequencies_are_refused_at_once(sldvexp, tmp_path):
    text = universal_text(closed_form((6, 4)))
    first = text.split("    -1\n    55")[1]
    path = tmp_path / "twice.uff"
    path.write_text(f"{text}    -1\n    55{first}")
    done = sldvexp("experiment=plate_model", "report=none", f"model.path={path}")
    assert done.status == 1
    assert "the mode is given twice; leave one out" in done.err
    path.write_text(text.replace("  1.98931E+02", "  0.00000E+00"))
    done = sldvexp("experiment=plate_model", "report=none", f"model.path={path}")
    assert "its shapes have no frequencies; give them in Hz with model.frequencies" in done.err


def _words(settings: str) -> list[str]:
    """Split settings at blanks outside of braces."""
    return settings.split(" ") if "{" not in settings else [settings]
