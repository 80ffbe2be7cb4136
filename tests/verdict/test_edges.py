"""Images that nothing can be made of: a sentence each, and no view is accused in vain."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from sldvexp.dataset import Severity
from sldvexp.field import View
from sldvexp.signal import Flag
from sldvexp.verdict import Examined, examine_views
from sldvexp.verdict.explanation import LEAST_VIEWS, Explanation, ViewTests
from sldvexp.verdict.repeated import cut_off
from sldvexp.verdict.wording import disagreement

from .simulated_views import LASER, groups, session, surface


def examined(views: list[View], **options: object) -> Examined:
    return examine_views(groups(views), LASER, surface(), **options)  # type: ignore[arg-type]


def changed(change: Callable[[View], View], *which: int, pixels: int = 25) -> list[View]:
    """Change some views of a clean session."""
    views = session(np.random.default_rng(3), pixels=pixels).views
    return [change(v) if k in which else v for k, v in enumerate(views)]


def flagged(share: float) -> Callable[[View], View]:
    def change(view: View) -> View:
        bad = np.random.default_rng(1).random(len(view.dac)) < share
        return replace(view, flags=np.where(bad, 2, view.flags))

    return change


def still(view: View) -> View:
    rng = np.random.default_rng(int(view.name[1:]))
    noise = rng.normal(size=(*view.velocity.shape, 2)) @ [1, 1j]
    return replace(view, velocity=view.std[0] * noise)


def with_noise_before(view: View) -> View:
    """Put frequencies without motion before those with it."""
    more = [still(replace(view, name=f"v{k}")).velocity for k in range(100, 109)]
    return replace(view, velocity=np.hstack([*more, view.velocity]))


def zero(view: View) -> View:
    return replace(view, velocity=0 * view.velocity)


def exact_zero(view: View) -> View:
    return replace(view, velocity=0 * view.velocity, std=0 * view.std)


@pytest.mark.parametrize("change", [zero, exact_zero])
def test_views_without_any_motion_are_not_compared(change):
    (found,) = examined(changed(change, *range(5))).findings
    assert found.text.startswith("the views are not compared, as nothing that they see moves")


def test_views_of_nothing_but_noise_accuse_none():
    found = examined(changed(still, *range(5), pixels=17)).findings
    assert {f.severity.name for f in found} <= {"note"}


@pytest.mark.whole
@pytest.mark.parametrize("change", [zero, still])
def test_view_at_rest_is_proposed_to_be_left_out_and_not_to_be_amplified(change):
    views = changed(change, 2)
    found = examined(views).findings[0]
    assert "hardly shows the motion" in found.text
    assert (found.subject, found.remedy) == ("view v3", "use_repair=[view_v3.left_out]")
    repaired = examined(views, use_repair=["view_v3.left_out"])
    assert {f.severity.name for f in repaired.findings} == {"note"}


def test_view_with_nine_of_ten_pixels_flagged_is_compared():
    assert not [f for f in examined(changed(flagged(0.9), 1)).findings if f.kind != "noise"]


@pytest.mark.whole
def test_view_with_hardly_a_pixel_does_not_keep_the_others_from_being_compared():
    views = changed(flagged(0.98), 1)
    views[3] = replace(views[3], velocity=-views[3].velocity)
    found = {f.kind: f for f in examined(views).findings}
    assert found["untested"].subject == "view v2"
    assert "and it takes 30" in found["untested"].text
    assert "view v4" in found["sign"].subject


def test_images_beside_the_surface_are_told_in_one_sentence():
    (found,) = examined(changed(flagged(2.0), *range(5))).findings
    assert found.subject == "views v1, v2, v3, v4, v5"


@pytest.mark.whole
def test_image_of_one_place_is_no_traceback():
    at_rest = changed(lambda v: replace(v, dac=0 * v.dac), 0)
    assert examined(at_rest).findings


@pytest.mark.whole
def test_of_many_frequencies_the_strongest_tell_of_all():
    views = changed(with_noise_before, *range(5))
    views[4] = replace(views[4], velocity=-views[4].velocity)
    bad = np.flatnonzero(views[0].usable)[200]
    views[0].velocity[bad, -1] += 0.05
    found = examined(views, use_repair=["view_v5.sign"])
    image = found.groups["image/v5"]
    assert image.sizes["frequency"] == 20
    np.testing.assert_array_equal(image["velocity"].values, -views[4].velocity)
    assert found.groups["image/v1"]["flags"].values[bad] == 32


@pytest.mark.whole
def test_millimetres_for_metres_are_no_exchange():
    views = changed(lambda v: replace(v, velocity=1e3 * v.velocity, std=1e3 * v.std), 1)
    found = examined(views).findings[0]
    assert (found.kind, found.subject) == ("gain", "view v2")
    assert "times what the others predict: are its units others?" in found.text


def test_factor_that_is_none_accuses_no_view():
    tests = ViewTests({"pose": np.ones(5)}, {"pose": np.full(5, 1e-3)}, 1.0, 0.5)
    slight = Explanation((0,), "gain", 0.0, 1.00002, (1e-5, 1e-5))
    finding, repairs = disagreement(list("abcde"), tests, slight, None)
    assert (finding.kind, finding.subject, repairs) == ("unexplained", "views", [])
    assert finding.severity.name == "doubtful"
    assert "view a was not taken from where its pose says" in finding.text
    clear = replace(slight, factor=1.01)
    assert disagreement(list("abcde"), tests, clear, None)[0].subject == "view a"


def turned_away(view: View) -> View:
    """Look from where the sign of z would have it: at the back, which no beam meets."""
    return replace(view, origin=view.origin * [1.0, 1.0, -1.0])


@pytest.mark.one_in(2)
@pytest.mark.parametrize("count", [5, 4])
def test_view_that_looks_beside_what_others_see_is_in_doubt(count):
    views = changed(turned_away, 2)[:count]
    [found] = [f for f in examined(views).findings if f.severity is not Severity.note]
    assert (found.kind, found.subject) == ("beside", "view v3")
    assert "0 of its 315 usable pixels meet it" in found.text


@pytest.mark.parametrize("count", [3, pytest.param(5, marks=pytest.mark.whole)])
def test_file_that_was_read_twice_is_named_of_three_views_too(count):
    views = changed(flagged(0.0), 0)[:count]
    views[2] = replace(views[2], velocity=views[1].velocity, flags=views[1].flags)
    found = {f.kind: f for f in examined(views).findings}
    assert found["repeated"].subject == "views v2 and v3"
    assert found["repeated"].severity is Severity.void
    repaired = examined(views, use_repair=["view_v3.left_out"]) if count > LEAST_VIEWS else None
    assert repaired is None or "repeated" not in {f.kind for f in repaired.findings}


def cut_at(share: float, part: Callable[[np.ndarray], np.ndarray]) -> Callable[[View], View]:
    """Cut off what is larger than all but this share of the pixels that see the panel."""

    def change(view: View) -> View:
        velocity = view.velocity.copy()
        line = velocity[view.usable, 0]
        most = np.quantile(part(line), 1 - share)
        if part is np.abs:
            line = line * np.minimum(1.0, most / np.abs(line))
        else:
            line = np.minimum(line.real, most) + 1j * line.imag
        velocity[view.usable, 0] = line
        return replace(view, velocity=velocity)

    return change


@pytest.mark.one_in(3)
@pytest.mark.parametrize("share", [0.1, 0.25])
@pytest.mark.parametrize("part", [np.abs, np.real])
def test_velocities_that_are_cut_off_are_named_and_left_out(share, part):
    spoiled = examined(changed(cut_at(share, part), 2))
    [found] = [
        f for f in spoiled.findings if f.severity is not Severity.note or f.kind == "cut_off"
    ]
    assert (found.kind, found.subject) == ("cut_off", "pixels of view v3")
    assert found.severity is (Severity.note if share < 0.15 else Severity.doubtful)
    flags = spoiled.groups["image/v3"]["flags"].values.astype(int)
    usable = changed(cut_at(share, part))[2].usable
    assert np.mean(flags[usable] & Flag.saturated != 0) == pytest.approx(share, abs=0.01)


def test_velocities_of_few_digits_are_not_cut_off():
    """The largest is met by more than a dozen pixels, but so are others."""

    def rounded(view: View) -> View:
        step = np.nanmax(np.abs(view.velocity)) / 8
        return replace(view, velocity=step * np.round(view.velocity.real / step) + 0j)

    view = changed(rounded, 2)[2]
    assert np.sum(view.velocity[view.usable, 0] == view.velocity[view.usable, 0].max()) > 12
    assert not cut_off(view).any()


@pytest.mark.parametrize("code", [0.0, 9.999, -0.999])
def test_numbers_that_stand_for_a_missing_velocity_are_not_cut_off(code):
    def missing(view: View) -> View:
        velocity = view.velocity.copy()
        velocity[::10] = code
        return replace(view, velocity=velocity)

    assert not cut_off(changed(missing, 2)[2]).any()


@pytest.mark.one_in(4)
@pytest.mark.parametrize("count", [3, 5])
@pytest.mark.parametrize("down", [True, False])
def test_line_that_was_recorded_twice_is_named_first(down, count):
    def late(view: View) -> View:
        place = np.arange(len(view.dac)).reshape(view.shape)
        place = place if down else place.T
        place[9:] = place[8:-1].copy()
        place = (place if down else place.T).ravel()
        return replace(view, velocity=view.velocity[place], flags=view.flags[place])

    found = examined(changed(late, 1, pixels=17)[:count]).findings[0]
    assert (found.kind, found.subject) == ("repeated_line", "lines of view v2")
    assert found.text.startswith("line 10 of view v2 has the same velocities as line 9")


def noisier(times: float) -> Callable[[View], View]:
    """Give a view noise that it does not state, or state noise that it does not have."""

    def change(view: View) -> View:
        if times < 1:
            return replace(view, std=view.std / times)
        rng = np.random.default_rng(5)
        more = np.sqrt(times**2 - 1) * view.std[:, None]
        drawn = rng.normal(size=view.velocity.shape) + 1j * rng.normal(size=view.velocity.shape)
        return replace(view, velocity=view.velocity + more * drawn)

    return change


@pytest.mark.one_in(3)
@pytest.mark.parametrize(("times", "count"), [(20.0, 4), (1.6, 5), (20.0, 5)])
def test_noise_of_one_view_that_is_larger_than_stated_is_named(times, count):
    views = changed(noisier(times), 2, pixels=17)[:count]
    [found] = [f for f in examined(views).findings if f.kind == "own_noise"]
    assert found.subject == "view v3"
    assert found.size == pytest.approx(times, rel=0.1)
    assert found.severity is (Severity.void if times > 2 else Severity.doubtful)


@pytest.mark.whole
def test_noise_of_one_view_is_told_apart_from_what_loose_poses_have_wrong_in_common():
    views = [replace(view, covariance=100 * view.covariance) for view in changed(noisier(1.6), 2)]
    [found] = [f for f in examined(views).findings if f.kind == "own_noise"]
    assert found.subject == "view v3"
    assert found.size == pytest.approx(1.6, rel=0.1)


@pytest.mark.whole
def test_noise_that_one_view_states_too_small_is_named_once():
    views = changed(lambda v: replace(v, std=v.std / 8), 2)
    [found] = [f for f in examined(views).findings if f.severity is not Severity.note]
    assert (found.kind, found.subject) == ("own_noise", "view v3")
    assert found.size == pytest.approx(8, rel=0.1)


@pytest.mark.whole
def test_noise_of_one_view_that_is_smaller_than_stated_accuses_none():
    found = examined(changed(noisier(0.1), 2)).findings
    assert {f.severity for f in found} <= {Severity.note}


def backlash(view: View) -> View:
    """Shift every second line by a pixel, as mirrors do that lag behind in both directions."""
    place = np.arange(len(view.dac)).reshape(view.shape)
    place[1::2] = np.roll(place[1::2], 1, axis=1)
    return replace(view, velocity=view.velocity[place.ravel()], flags=view.flags[place.ravel()])


@pytest.mark.whole
def test_lines_that_are_shifted_are_no_other_pose():
    found = examined(changed(backlash, 2), robust=False).findings[0]
    assert (found.kind, found.subject) == ("own_noise", "view v3")
    assert "lines in another order" in found.text


@pytest.mark.whole
@pytest.mark.parametrize("times", [0.1, 3.0])
def test_noise_of_one_view_does_not_hide_what_is_wrong_with_another(times):
    views = changed(noisier(times), 2)
    views[1] = replace(views[1], velocity=1.1 * views[1].velocity)
    found = {f.kind: f for f in examined(views).findings}
    assert found["gain"].subject == "view v2"
    assert found["gain"].severity is Severity.void


@pytest.mark.whole
@pytest.mark.parametrize("times", [3.0, 50.0])
def test_instrument_that_vibrates_itself_is_named(times):
    views = changed(
        lambda v: replace(v, velocity=v.velocity + times * (1 - 0.7j) * v.std[0]), 2, pixels=17
    )
    found = examined(views).findings[0]
    assert (found.kind, found.subject) == ("offset", "view v3")
    assert found.severity is Severity.void
