"""The fitted conics and all bitangent points that `pose=bitangent` leaves in the run."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sldvexp.geometry import Ellipse
from sldvexp.image import pinhole_from_dac
from sldvexp.image.matching import Match
from sldvexp.laser import project
from sldvexp.pose.bitangent import Bitangent
from sldvexp.pose.circle_images import CircleImages
from sldvexp.pose.conics import coefficients, conics_to_dataset
from sldvexp.targets import Circle, Circles
from sldvexp.units import LengthUnit


@pytest.fixture(scope="module")
def exact(edge_lab):
    """Without a mirror offset the image of a circle is an ellipse in pinhole coordinates."""
    return edge_lab(views=2, nominal=0.0)


@pytest.fixture(scope="module")
def found(exact):
    return Bitangent().estimate(exact.laser, exact.target, exact.tree(None))


def test_all_48_points_are_images_of_those_on_the_object(exact, found):
    group, known = found.groups()["conic"], exact.target.all_bitangents()
    assert group.sizes["bitangent_point"] == 48
    assert group["touched"].values.tolist() == list(known.label)
    for k, name in enumerate(exact.names):
        rotation, origin = exact.truth(name)
        image = exact.laser.dac_from_angle(project((known.position - origin) @ rotation.T))
        np.testing.assert_allclose(group["bitangent"][k], image, atol=1e-5)


def test_registered_points_are_the_registration(found):
    group, table = found.groups()["conic"], found.groups()["registration"]
    number = group["registered"].values
    assert sorted(number[number > 0]) == table["point"].values.tolist()
    used = group.isel(bitangent_point=np.argsort(number)[-16:])
    np.testing.assert_allclose(used["bitangent"], table["dac"], atol=1e-9)


@pytest.mark.one_in(2)
@pytest.mark.parametrize("pinhole", [True, False])
def test_coefficients_vanish_on_the_edges(exact, pinhole):
    found = Bitangent(pinhole=pinhole).estimate(exact.laser, exact.target, exact.tree(None))
    group = found.groups()["conic"]
    assert group["term"].values.tolist() == list("ABCDEF")
    assert ("pinhole" in group.attrs["plane"]) is pinhole
    for k, name in enumerate(exact.names):
        for n, edges in exact.edges(None)[name].items():
            dac = edges.position
            x, y = (pinhole_from_dac(exact.laser, dac) if pinhole else dac).T
            a, b, c, d, e, f = group["coefficient"].sel(circle=n).values[k]
            assert a + b == pytest.approx(1, abs=1e-12)
            value = a * x**2 + b * y**2 + c * x * y + d * x + e * y + f
            slope = np.hypot(2 * a * x + c * y + d, 2 * b * y + c * x + e)
            # In steps; in DAC steps a circle's image is no ellipse. Spots are freed of their size.
            assert np.abs(value / slope).max() < (0.02 if pinhole else 0.5)


def circle_image(x, y, r=1.0):
    return Ellipse(np.array([x, y, r**2, r**2, 0.0]), np.zeros((5, 5)))


def drawn(ellipses, mirrored=False):
    match = Match(dict.fromkeys(ellipses, 0), mirrored, 0.0, np.inf)
    return CircleImages("front", {}, None, match, 1.0, ellipses)


THREE = Circles(
    unit=LengthUnit.cm,
    circles={1: Circle(0.0, 0.0, 2.0), 2: Circle(9.0, 0.0, 2.0), 3: Circle(0.0, 9.0, 2.0)},
)


def test_in_a_mirror_image_left_and_right_change_places(exact):
    # up-down and left-right of a viewer; y to the left of x, and in the mirror to the right
    upright = {1: circle_image(0, 0), 2: circle_image(9, 0), 3: circle_image(0, 9)}
    turned = {1: circle_image(0, 0), 2: circle_image(9, 0), 3: circle_image(0, -9)}
    one = conics_to_dataset([drawn(upright)], THREE, exact.laser, pinhole=False)
    other = conics_to_dataset([drawn(turned, mirrored=True)], THREE, exact.laser, pinhole=False)
    np.testing.assert_allclose(other["bitangent"], one["bitangent"] * [1, -1], atol=1e-12)
    assert one["bitangent"][0, 0].values.tolist() == pytest.approx([0, 1])


def test_pairs_whose_images_overlap_have_no_points(exact):
    images = {1: circle_image(0, 0), 2: circle_image(9, 0), 3: circle_image(1, 0)}
    group = conics_to_dataset([drawn(images)], THREE, exact.laser, pinhole=False)
    missing = np.isnan(group["bitangent"][0]).any("mirror").values.reshape(3, 8)
    assert missing.all(axis=1).tolist() == [False, True, False]
    assert not missing[[0, 2]].any()


def test_a_conic_through_the_origin_has_coefficients():
    through = coefficients(np.array([2.0, 0.0, 4.0, 4.0, 0.0]))
    np.testing.assert_allclose(through, [0.5, 0.5, 0, -2, 0, 0], atol=1e-15)


def test_pairs_told_the_other_way_round_keep_their_points(exact, found):
    other = replace(exact.target, pairs=["2-1", "2-3", "3-4", "4-1"])
    group = Bitangent().estimate(exact.laser, other, exact.tree(None)).groups()["conic"]
    known = other.points()
    labels = dict(zip(group["registered"].values, group["touched"].values, strict=True))
    position = dict(zip(other.all_bitangents().label, other.all_bitangents().position, strict=True))
    for number, place in zip(known.number, known.position, strict=True):
        np.testing.assert_allclose(position[labels[number]], place, atol=1e-12)
