"""A velocity image: what is measured is what truly moves, and what cannot be trusted is told."""

from __future__ import annotations

import numpy as np
import pytest

from sldvexp.errors import ConfigError, UserError
from sldvexp.laser import rays
from sldvexp.session.images import image_to_dataset
from sldvexp.session.session import scan_views
from sldvexp.signal import Flag, demodulate, sine_model
from sldvexp.virtual_lab import VirtualLab

CORNERS = "[[-630, 130], [-630, -1400], [640, -1400], [640, 130]]"
BESIDE = "[[-1640, 140], [-1640, 40], [-1540, 40], [-1540, 140]]"


def image_scan(*overrides, view="a", corners=CORNERS):
    views = f"scan.views={{{view}: {{corners: {corners}}}}}"
    return ["scan=rectangle", views, "scan.pixels=[14,16]", *overrides]


def truth(experiment, view, image):
    """V . D of the virtual plate where the beam of each pixel meets it, m/s for 1 V."""
    lab = VirtualLab(experiment.scene, experiment.laser, experiment.target, experiment.seed)
    rotation, origin = lab.true_pose(view)
    start, along = rays(image["angle"].values)
    begin, direction = origin + start @ rotation, along @ rotation
    direction /= np.linalg.norm(direction, axis=-1, keepdims=True)
    distance = (0.0015 - begin[:, 2]) / direction[:, 2]
    points = begin + distance[:, None] * direction
    velocity = [lab.plate.velocity(points, f) for f in image["frequency"].values]
    return -np.einsum("fpi,pi->pf", velocity, direction)


@pytest.mark.one_in(4)
@pytest.mark.parametrize("frequency", [[439.0], [197.0, 520.0]])
@pytest.mark.parametrize("view", ["a", "b"])
def test_an_image_is_the_true_velocity_within_its_standard_errors(
    composed, tmp_path, frequency, view
):
    experiment = composed(*image_scan(f"scan.sampling.frequency={frequency}", view=view))
    image = scan_views(experiment, tmp_path)[f"image/{view}"]
    assert image["frequency"].values.tolist() == frequency
    assert image.attrs["shape"] == [14, 16]
    good = image["flags"].values == 0
    error = (image["velocity"].values - truth(experiment, view, image))[good]
    score = np.abs(error) ** 2 / image["velocity_std"].values[good] ** 2 / 2
    # Means of unit exponentials, by four standard deviations.
    assert abs(score.mean() - 1) < 4 / np.sqrt(score.size)
    # Before the correction nothing but the amplitude is right.
    before = image["uncorrected"].values[good]
    np.testing.assert_allclose(np.abs(before), np.abs(image["velocity"].values[good]), rtol=1e-9)
    wrong = np.abs(before - truth(experiment, view, image)[good]) ** 2
    assert (wrong / image["velocity_std"].values[good] ** 2).mean() > 1000


def test_pixels_are_where_the_scan_says(composed, tmp_path):
    experiment = composed(*image_scan())
    image = scan_views(experiment, tmp_path)["image/a"]
    grid = image["dac"].values.reshape(*image.attrs["shape"], 2)
    np.testing.assert_array_equal(grid[0, 0], [-630, -1400])
    np.testing.assert_array_equal(grid[-1, 0], [640, -1400])
    np.testing.assert_array_equal(grid[0, -1], [-630, 130])
    wanted = experiment.laser.angle_from_dac(image["dac"].values)
    np.testing.assert_array_equal(image["angle"].values, wanted)


def test_flagged_pixels_are_kept_and_counted(composed, tmp_path):
    experiment = composed(*image_scan("scene.vibrometer.drop_out=0.2"))
    image = scan_views(experiment, tmp_path)["image/a"]
    flags = image["flags"]
    dropped = int((flags.values & Flag.dropped_out != 0).sum())
    # 224 pixels of which each drops out with 0.2: 45 +- 6.
    assert 21 < dropped < 69
    assert image.attrs["summary"].startswith(f"{(flags.values != 0).sum()} of 224 pixels are")
    assert f"dropped_out {dropped}" in image.attrs["summary"]
    assert np.isfinite(image["velocity"].values).all()
    names = flags.attrs["flag_meanings"].split()
    assert dict(zip(names, flags.attrs["flag_masks"], strict=True)) == Flag.__members__


@pytest.mark.whole
def test_refined_frequencies_stand_beside_those_that_were_set(composed, tmp_path):
    chosen = image_scan("scene.generator_error=0.001", "signal.refine=true", "signal.search=2")
    image = scan_views(composed(*chosen), tmp_path)["image/a"]
    assert image["frequency"].values.tolist() == [450.0]
    off = image["refined_frequency"].values - 450.45
    assert abs(off[0]) < 5 * image["refined_frequency_std"].values[0] < 0.01


@pytest.mark.whole
@pytest.mark.parametrize(
    ("wrong", "told"),
    [
        (["scene.generator_gain=0"], r"reference_missing 224\): .*generator's output is off"),
        (["scene.digitizer.reference_gain=0"], r"reference_missing 224\): .*not plugged in"),
        (["scene.generator_error=0.1"], r"poor_fit 224.*other frequencies than"),
        (["scene.digitizer.reference_range=0.5"], r"saturated 224"),
        (["scene.shutter_open=false"], r"dropped_out 224\): no light comes back"),
    ],
)
def test_an_image_without_a_good_pixel(composed, tmp_path, wrong, told):
    with pytest.raises(UserError, match=told) as error:
        scan_views(composed(*image_scan(*wrong)), tmp_path)
    text = str(error.value)
    assert text.startswith("scan: in the image of the view a 224 of 224 pixels are flagged (")
    assert text.endswith(f"delete {tmp_path / 'a' / 'image'}_* and resume the run")
    # What the operator is told helps.
    for path in (tmp_path / "a").glob("image_*"):
        path.unlink()
    (tmp_path / "configuration.sha256").unlink()  # of a scene that nobody can repair in this test
    scan_views(composed(*image_scan()), tmp_path)


def test_no_light_beside_everything(composed, tmp_path):
    chosen = image_scan("scene.backdrop=false", corners=BESIDE)
    with pytest.raises(UserError, match="no light comes back from 224 of 224 pixels"):
        scan_views(composed(*chosen), tmp_path)


def test_nothing_is_scanned_if_a_pixel_cannot_be_reached(composed, tmp_path):
    corners = "[[-640, 140], [-640, -5000], [660, -5000], [660, 140]]"
    chosen = image_scan(f"scan.views={{z: {{corners: {corners}}}}}")
    with pytest.raises(UserError, match=r"in the view z, point 0: the left_right DAC step -5000"):
        scan_views(composed(*chosen), tmp_path)
    assert list(tmp_path.rglob("*.npz")) == []


def test_a_scan_of_no_view(composed, tmp_path):
    with pytest.raises(ConfigError, match=r"scan\.views: needs at least one view"):
        scan_views(composed("scan=list"), tmp_path)


def test_constants_of_the_records_are_tested():
    """One in twenty is found where there is none, and every one of half the noise."""
    pixels, samples = 400, 256
    rng, times = np.random.default_rng(1), np.arange(256) / 2560
    records = np.cos(2 * np.pi * 200 * times) + 0.1 * rng.normal(size=(pixels, 2, samples))
    records[: pixels // 2, 0] += 0.05
    image = demodulate(records, sine_model(times, [200.0]))
    dac = np.zeros((pixels, 2), int)
    group = image_to_dataset(image, dac, np.radians(dac), [200.0])
    assert group["f_p_value"].dims == ("pixel", "channel")
    of_velocity, of_reference = group["f_p_value"].values.T
    assert np.all(of_velocity[: pixels // 2] < 1e-3)
    for p in (of_velocity[pixels // 2 :], of_reference):
        assert abs(np.mean(p < 0.05) - 0.05) < 3 * np.sqrt(0.05 * 0.95 / len(p))
    kept = group["f_p_value"].sel(channel="velocity") < 0.05
    np.testing.assert_array_equal(image.velocity_fit.intercept, kept)
