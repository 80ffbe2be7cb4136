"""Strain from one image, and fields that views or pixels leave open: told, given where they can."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sldvexp.errors import UserError
from sldvexp.shell import Spline, estimate_surface
from tests.shell import simulated_shell as lab

FREE = Spline()


def estimated(views, method=None, volume=None):
    return estimate_surface(
        views,
        lab.LASER,
        volume or lab.volume(),
        method or lab.method(),
        lab.SHEET,
        frequency=[lab.FREQUENCY],
    )


def errors(found, truth, part):
    """Root mean square error of each strain over that of the truth, of one part."""
    true = part(truth.strain(found.prisms.surface, lab.FREQUENCY))
    error = part(found.strain()["strain"].values[..., 0]) - true
    return np.linalg.norm(error, axis=0) / np.linalg.norm(true, axis=0)


def notes(found):
    return [n for g in (found.field(), found.strain()) for n in g.attrs["notes"].splitlines()]


@pytest.mark.one_in(6)
@pytest.mark.parametrize("view", range(len(lab.PLACES)))
def test_one_image_tells_the_strain_of_bending(view):
    """Pixels as many as those of bare sldvexp, with their noise."""
    truth = lab.plate()
    views = lab.views(truth, np.random.default_rng(view), pixels=(41, 49))
    found = estimated([views[view]])
    assert np.all(errors(found, truth, np.imag) < 0.03)  # resonant: strain lags velocity by 90 deg


@pytest.mark.whole
def test_one_image_does_not_tell_what_stretches_the_middle():
    """Bounds hold it nevertheless, and a note says so; five views find it."""
    truth, rng = lab.plate(), np.random.default_rng(1)
    views = lab.views(truth, rng, pixels=(21, 25))
    one, five = estimated(views[:1]), estimated(views)
    assert np.all(errors(one, truth, np.real)[:2] > 0.8)
    assert np.all(errors(five, truth, np.real)[:2] < 0.35)
    strain = one.strain()
    off = np.abs((strain["strain"].values[..., 0] - truth.strain(one.prisms.surface, 197.0)).real)
    assert np.mean(off <= 1.96 * strain["strain_std_by_part"].values[0, :, :, 0]) > 0.95
    told = notes(one)
    assert any(note.startswith("one view sees the face: it cannot tell") for note in told)
    assert any(note.startswith("the bounds of e_ss, e_tt") for note in told)
    assert not [note for note in notes(five) if "bounds of" in note or "one view" in note]


@pytest.mark.whole
@pytest.mark.parametrize("count", [1, 2])
def test_free_splines_name_what_few_views_leave_open(count):
    views = lab.views(lab.plate(), np.random.default_rng(2), pixels=(15, 17))
    found = estimated(views[:count], FREE)
    group = found.field()
    assert not group["observable"].values[:, :2].any(axis=0).all()
    told = [note for note in notes(found) if "not determined" in note]
    assert told
    assert "at 286 of 286 nodes" in " ".join(told)
    assert estimated(views, FREE).field()["observable"].values.all()


def without(view, left_out):
    flags = np.asarray(view.flags).copy()
    flags[left_out] = 1
    return replace(view, flags=flags)


def test_a_part_without_pixels_is_named_and_the_rest_given():
    """Five views of the plate's first half."""
    truth = lab.plate()
    views = lab.views(truth, np.random.default_rng(3), pixels=(20, 20))
    second = np.arange(400) >= 200
    found = estimated([without(v, second) for v in views])
    group, place = found.field(), found.fit.outline.corners
    determined = group["observable"].values[:, 2] == 1
    seen = determined[: len(place)]
    assert seen[place[:, 0] < 0].all()
    assert not seen[place[:, 0] > 0.12].any()
    assert f"z is not determined at {(~determined).sum()} of 286 nodes" in " ".join(notes(found))
    true = truth.velocity(found.prisms.surface, lab.FREQUENCY)[:, 2]
    error = group["velocity"].values[: len(place), 2, 0] - true
    assert np.abs(error[place[:, 0] < -0.02]).max() < 0.01 * np.abs(true).max()


@pytest.mark.one_in(2)
@pytest.mark.parametrize("method", [None, FREE])
def test_pixels_on_a_line_leave_the_rest_open(method):
    views = lab.views(lab.plate(), np.random.default_rng(4), pixels=(60, 11))
    others = np.arange(660) % 11 != 5
    found = estimated([without(v, others) for v in views], method)
    determined = found.field()["observable"].values[:143, 2].reshape(13, 11)
    assert determined[:, 5].all()  # on the line itself
    assert determined.mean() < 0.5
    assert any("z is not determined at" in note for note in notes(found))


def test_too_few_pixels_are_counted():
    views = lab.views(lab.plate(), np.random.default_rng(5), pixels=(5, 5))
    with pytest.raises(UserError, match=r"^25 pixels of all views together .* where 30 are needed"):
        estimated(views[:1])
