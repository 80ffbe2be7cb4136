"""Bad inputs of a surface's field, each through the command: one sentence, and nothing kept."""

from __future__ import annotations

import numpy as np
import pytest

SMALL = [
    *("experiment=plate", "report=none", "pose=bitangent", "volume.shape=[7,6]", "check={}"),
    *("~scan.calibration.views.4", "~scan.calibration.views.5"),
    *("~scan.structure.views.4", "~scan.structure.views.5"),
    *(f"scan.{part}.sampling.samples=256" for part in ("calibration", "structure")),
    *("scan.calibration.fine.lines=16", "scan.structure.pixels=[11,13]"),
]
HEADER = "gage,frequency,amplitude [{}],phase_deg,std [{}]\n"
CHECK = "+check={{g: {{plugin: gages, path: {}, gages: {{a: {{place: {}}}}}}}}}"


@pytest.fixture(scope="module")
def run(run_once):
    """Images of a small session."""
    return run_once(*SMALL)


@pytest.fixture
def told(run, sldvexp):
    """Call the command on the images with a surface's field; give its sentence."""

    def call(*words, volume="grid"):
        done = sldvexp(
            *("~experiment", "instrument=images", f"instrument.path={run}", "laser=ometron"),
            *("pose=given", f"pose.path={run}/run.nc", f"volume={volume}", "report=none"),
            *("volume.center=[0.42,0.14,0]", "volume.thickness=0.024"),
            *(["volume.size=[0.26,0.21]", "volume.shape=[9,7]"] if volume == "grid" else []),
            *words,
        )
        assert done.status == 1, done.out
        assert list(done.folder.rglob("run.nc")) == []
        lines = done.err.strip().splitlines()
        assert len(lines) == 1, lines
        return lines[0].removeprefix("sldvexp: ")

    return call


#: Thin plate of the lab.
SHELL = ("reconstruction=shell", "material=aluminium", "material.thickness=0.003")


@pytest.mark.whole
@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (
            ["reconstruction=shell"],
            "reconstruction: needs the sheet's thickness: choose material=aluminium",
        ),
        (
            ["reconstruction=shell", "material=aluminium"],
            "material.thickness must be given, in m, as in 0.003: strain and motion along the",
        ),
        (
            [*SHELL, "volume.center=[3,0,0]"],
            "reconstruction: 0 pixels of all views together meet the surface from the side of its "
            "normals, where 30 are needed: does the volume lie where the structure is, inside of",
        ),
        (
            [*SHELL, "volume.euler=[0,3.14159,0]"],
            "reconstruction: the surface turns its back to all views: its normals point away from",
        ),
        (
            [*SHELL, "volume.size=[0.02,0.02]"],
            "reconstruction: 3 pixels of all views together meet the surface from the side of its",
        ),
    ],
)
def test_what_a_surface_needs(told, words, sentence):
    assert told(*words).startswith(sentence)


@pytest.mark.whole
def test_a_surface_that_crosses_itself(told, tmp_path):
    """A flat band once around and a sixth more."""
    angles = np.radians(35 * np.arange(13))
    nodes = [f"v {r * np.cos(a):.6f} {r * np.sin(a):.6f} 0" for a in angles for r in (0.05, 0.1)]
    bands = [f"f {k} {k + 1} {k + 3} {k + 2}" for k in range(1, 24, 2)]
    (tmp_path / "band.obj").write_text("\n".join([*nodes, *bands]))
    answer = told(*SHELL, "volume.path=band.obj", volume="mesh")
    assert answer.startswith("reconstruction: the volume's surface crosses itself: ")
    assert "of 24 triangles lie over others, between" in answer


@pytest.mark.whole
@pytest.mark.parametrize(
    ("gage", "sentence"),
    [
        ("[0, 0], length: 0.4", "a, 400 x 3 mm, is longer than the surface, 260 x 210 mm"),
        ("[0.2, 0]", "a is not on the surface with its whole grid of 6 x 3 mm: place is within"),
    ],
)
def test_gages_that_are_not_on_the_surface(told, gage, sentence):
    assert told(*SHELL, CHECK.format("null", gage)).startswith(f"check.gages: {sentence}")


@pytest.mark.whole
@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (None, "m.csv: there is no such file"),
        (HEADER.format("mV", "mV") + "a,197,1,2,3", "amplitude [mV]: unknown unit of strain 'mV'"),
        (HEADER.format("um/m", "") + "a,197,1,2,3", "std []: states no unit of strain"),
        (
            HEADER.format("um/m", "um/m") + "a,300,1,2,3",
            "has no strain at a frequency of the run: it has 300 Hz, the run 197 Hz",
        ),
        (HEADER.format("um/m", "um/m") + "b,197,1,2,3", "gage b is none of check.gages"),
    ],
)
def test_files_of_gages_with_other_units_lines_or_names(told, tmp_path, text, sentence):
    if text is not None:
        (tmp_path / "m.csv").write_text(text)
    answer = told(*SHELL, CHECK.format("m.csv", "[0, 0]"))
    assert answer.removeprefix("m.csv: ").startswith(sentence.removeprefix("m.csv: "))
