"""Universal files as other programs write them: filling, orders of bytes, repetitions."""

from __future__ import annotations

import numpy as np
import pytest

from sldvexp.errors import UserError
from sldvexp.io.uff import universal_file

POINTS = [[0, 0, 0], [0.15, 0, 0], [0.15, 0.1, 0], [0, 0.1, 0]]
FREQUENCY = 100.0 + 10 * np.arange(5)
FIRST = np.array([9.6e-4 + 3.0e-4j, 9.7e-4 + 5.3e-4j, 9.2e-4 + 7.7e-4j, 8.1e-4 + 1.0e-3j, 6.4e-4])


@pytest.mark.parametrize("filling", [b"\n\n", b"\r\n\r\n", b"\0" * 100, b"\0\0\n", b" \n"])
def test_filling_between_binary_values_and_the_mark(uff, tmp_path, filling):
    path = tmp_path / "a.uff"
    path.write_bytes(uff.binary(1, FIRST, before_mark=filling) + uff.nodes(POINTS))
    with universal_file(path) as file:
        np.testing.assert_allclose(file.values(file.functions[0])[1], FIRST, rtol=1e-6)
        assert file.geometry is not None


@pytest.mark.parametrize("more", [{}, {"type_": 6}, {"abscissa": FREQUENCY}])
@pytest.mark.parametrize("order", "<>")
def test_either_order_of_bytes_is_told_from_the_other(uff, tmp_path, order, more):
    path = tmp_path / "a.uff"
    content = uff.binary(1, FIRST, order=order, **more)
    path.write_bytes(content)
    with universal_file(path) as file:
        np.testing.assert_allclose(file.values(file.functions[0])[1], FIRST, rtol=1e-6)
    number = (b"58b     1", b"58b     2")
    path.write_bytes(content.replace(*(number if order == "<" else number[::-1]), 1))
    with universal_file(path) as file, pytest.raises(UserError, match="number behind 58b must be"):
        file.values(file.functions[0])
    path.write_bytes(uff.binary(1, 0 * FIRST, order=order, **more))
    with universal_file(path) as file:
        assert not file.values(file.functions[0])[1].any()


def test_zeros_that_fill_a_last_line_but_no_others(uff, tmp_path):
    path = tmp_path / "a.uff"
    values = uff.function(1, FIRST[:4], abscissa=FREQUENCY[:4])
    path.write_bytes(values)
    with universal_file(path) as file:
        assert len(file.values(file.functions[0])[1]) == 4
    claimed = b"         5         4"
    for claims in (b"         5         3", b"         5         2"):
        path.write_bytes(values.replace(claimed, claims))
        with universal_file(path) as file, pytest.raises(UserError, match="but there are more"):
            file.values(file.functions[0])


def test_nodes_given_twice_must_be_alike(uff, tmp_path):
    path = tmp_path / "a.uff"
    exact = np.array(POINTS) * (1 + 1e-7)
    for one, two in (
        (uff.nodes(exact), uff.nodes_15(POINTS)),
        (uff.nodes_15(POINTS), uff.nodes(exact)),
    ):
        path.write_bytes(one + two)
        with universal_file(path) as file:
            np.testing.assert_array_equal(file.geometry.position, exact)
    path.write_bytes(uff.nodes(POINTS) + uff.nodes_15(np.array(POINTS) + 1e-3))
    with universal_file(path) as file, pytest.raises(UserError, match=r"here at .* before at"):
        _ = file.geometry


def test_coordinate_systems_given_twice_must_be_alike(uff, tmp_path):
    path = tmp_path / "a.uff"
    turned = np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1.0]])
    one = uff.systems({5: (turned, [0.1, 0, 0])})
    path.write_bytes(one * 2 + uff.nodes(POINTS, motion=5))
    with universal_file(path) as file:
        np.testing.assert_array_equal(file.geometry.system[0].axes, turned)
    path.write_bytes(one + uff.systems({5: (turned, [0.2, 0, 0])}) + uff.nodes(POINTS, motion=5))
    with universal_file(path) as file, pytest.raises(UserError, match="5 is given twice"):
        _ = file.geometry
