"""The outline of the virtual plate is scanned and gives the pose, or a sentence says why not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sldvexp.errors import UserError
from sldvexp.geometry import vector_from_rotation
from sldvexp.pose.part import Part
from sldvexp.session.session import scan_views
from sldvexp.units import LengthUnit

POSE = "{origin: [0.28, 0.54, 1.64], look_at: [0.31, 0.15, 0.0]}"
#: The plate of the scene, which stands beside the calibration object.
MESH = "v 270 15 1.5\nv 570 15 1.5\nv 570 265 1.5\nv 270 265 1.5\nf 1 2 3 4\n"
FREE = (
    "scene.plate.edges=free",
    "scene.plate.spot_edges=true",
    "scene.vibrometer.drop_out=0",
    "scene.plate.modes={twist: {x: 1, y: 1, frequency: 150.0, velocity: 0.02}}",
)
SAMPLING = "{frequency: [150.0], rate: 5120.0, samples: 64}"


@pytest.fixture
def outlined(composed, tmp_path):
    """An experiment that scans the outline of the plate from one view."""
    path = tmp_path / "plate.obj"
    path.write_text(MESH)

    def made(*overrides, sampling=SAMPLING):
        e = composed(
            "scan=outline",
            f"scan.views={{a: {{pose: {POSE}}}}}",
            f"scan.path={path}",
            "scan.unit=mm",
            "scan.lines=40",
            f"scan.sampling={sampling}",
            *FREE,
            *overrides,
        )
        return replace(e, target=None)

    return made


def pose_error(e, groups):
    found = Part().estimate(e.laser, None, groups)
    truth = e.scene.views["a"]
    turned = vector_from_rotation(found.rotation[0] @ truth.rotation.T)
    return found, np.concatenate([turned, found.origin[0] - truth.place])


def test_the_outline_gives_the_pose(outlined, tmp_path):
    e = outlined()
    groups = scan_views(e, tmp_path / "journal")
    found, error = pose_error(e, groups)
    assert groups["edge/a"].sizes["edge"] > 30
    assert np.abs(error).max() < 3e-4
    std = np.sqrt(np.diag(found.pose["covariance"].values[0]))
    assert (np.abs(error) < 4 * std).all()
    assert all(f.severity.name == "note" for f in found.findings)


@pytest.mark.whole
def test_where_no_light_comes_back_the_light_tells_the_outline(outlined, tmp_path):
    e = outlined("scene.backdrop=false", "scene.plate.spot_edges=false")
    groups = scan_views(e, tmp_path / "journal")
    found, error = pose_error(e, groups)
    # Edges are where the beam's middle leaves the plate, to a step over the root of 12.
    std = np.sqrt(np.diag(found.pose["covariance"].values[0]))
    assert (np.abs(error) < 4 * std).all()
    assert np.abs(error[3:]).max() < 1.5e-3


@pytest.mark.one_in(3)
@pytest.mark.parametrize(
    ("overrides", "told"),
    [
        (["scene.plate.edges=supported"], "the outline in the view a is not shown: .*held edges"),
        (["scene.shutter_open=false"], "the outline in the view a"),
        (["scan.unit=m"], r"in the view a, .* is 300 m large in m .* is it in cm or mm or inch\?"),
        (
            ["scan.views.a.pose.look_at=[0.0, 1.0, 4.0]"],
            "in the view a, no outline of the part is before the instrument",
        ),
        (
            ["scan.views.a.pose.look_at=[-2.5, 0.15, 0.0]"],
            "mirrors do not reach the part's outline",
        ),
    ],
)
def test_an_outline_that_is_not_shown_is_said(outlined, tmp_path, overrides, told):
    with pytest.raises(UserError, match=told) as refused:
        scan_views(outlined(*overrides), tmp_path / "journal")
    assert str(refused.value).count("\n") == 0


@pytest.mark.whole
def test_a_session_scans_outline_and_image_from_one_place(composed, tmp_path):
    path = tmp_path / "plate.obj"
    path.write_text(MESH)
    e = composed(
        "scan=session",
        f"scan.poses={{a: {POSE}}}",
        f"scan.outline.path={path}",
        "scan.outline.unit=mm",
        "scan.outline.lines=30",
        f"scan.outline.sampling={SAMPLING}",
        "scan.structure.corners_at=[[0.3, 0.05, 0], [0.54, 0.05, 0], [0.54, 0.23, 0]]",
        "scan.structure.pixels=[4, 5]",
        f"scan.structure.sampling={SAMPLING}",
        *FREE,
    )
    e = replace(e, target=None)
    groups = scan_views(e, tmp_path / "journal")
    assert sorted(groups) == ["edge/a", "image/a"]
    assert np.abs(pose_error(e, groups)[1]).max() < 4e-4


def raster(composed, tmp_path, *overrides):
    """A quick raster of the whole plate, and the method that finds its outline there."""
    path = tmp_path / "plate.obj"
    path.write_text(MESH)
    corners = "[[0.24, -0.02, 0], [0.6, -0.02, 0], [0.6, 0.3, 0], [0.24, 0.3, 0]]"
    e = composed(
        "scan=rectangle",
        f"scan.views={{a: {{pose: {POSE}}}}}",
        f"scan.corners_at={corners}",
        "scan.pixels=[60, 70]",
        f"scan.sampling={SAMPLING}",
        *FREE,
        *overrides,
    )
    e = replace(e, target=None)
    rough = e.scan.views["a"].pose
    groups = scan_views(e, tmp_path / "journal")
    return e, groups, Part(path=str(path), unit=LengthUnit.mm, views={"a": rough})


@pytest.mark.whole
def test_a_quick_raster_gives_a_pose_too(composed, tmp_path):
    e, groups, method = raster(composed, tmp_path)
    found = method.estimate(e.laser, None, groups)
    truth = e.scene.views["a"]
    error = found.origin[0] - truth.place
    # Pixels are 6 mm apart, and the plate is seen nearly from its front.
    assert np.abs(error).max() < 0.15
    assert (np.abs(error) < 4 * found.pose["origin_std"].values[0]).all()


def test_a_raster_without_an_outline_is_refused(composed, tmp_path):
    e, groups, method = raster(composed, tmp_path, "scene.plate.edges=supported")
    quiet = groups["image/a"].copy()
    quiet["velocity"] = quiet["velocity"] * 1e-6
    with pytest.raises(UserError, match="view a: the raster shows no outline of a part"):
        method.estimate(e.laser, None, {"image/a": quiet})
    with pytest.raises(UserError, match="there is no image of a view a"):
        method.estimate(e.laser, None, {"image/b": quiet})
    del quiet.attrs["shape"]
    with pytest.raises(UserError, match="its image is no raster"):
        method.estimate(e.laser, None, {"image/a": quiet})


@pytest.mark.whole
def test_lines_that_were_scanned_are_not_scanned_again(outlined, tmp_path):
    e = outlined()
    first = scan_views(e, tmp_path / "journal")
    blind = replace(e, scene=replace(e.scene))
    again = scan_views(blind, tmp_path / "journal")
    assert first["edge/a"].identical(again["edge/a"])
