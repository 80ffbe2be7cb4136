"""Universal files as many programs write them come out with their numbers."""

from __future__ import annotations

from contextlib import contextmanager

import numpy as np
import pytest

from sldvexp.io.uff import universal_file

REAL = np.array([1.0, -2.5, 3e-7, -4e8, 5.0, 6.0, -7.125])
COMPLEX = REAL + 1j * REAL[::-1]
UNEVEN = np.array([0.0, 1.0, 3.0, 3.5, 10.0, 11.0, 20.0])
PLATE = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]


@pytest.fixture
def opened(tmp_path):
    @contextmanager
    def open_(content):
        path = tmp_path / "file.uff"
        path.write_bytes(content)
        with universal_file(path) as file:
            yield file

    return open_


@pytest.fixture
def read(opened):
    """The one function of a file: header, abscissa, ordinate."""

    def read_(content):
        with opened(content) as file:
            (function,) = file.functions
            return function, *file.values(function)

    return read_


@pytest.mark.parametrize("uneven", [False, True])
@pytest.mark.parametrize("type_", [2, 4, 5, 6])
@pytest.mark.parametrize("form", ["text", "<", ">", "< double abscissa"])
def test_every_kind_of_values(uff, read, form, type_, uneven):
    values = REAL if type_ in (2, 4) else COMPLEX
    abscissa = UNEVEN if uneven else None
    more = {"abscissa": abscissa, "type_": type_, "first": 2.0, "step": 0.5}
    if form == "text":
        content = uff.function(7, values, **more)
    else:
        size = 8 if "double" in form and type_ in (4, 6) else 4
        content = uff.binary(7, values, order=form[0], abscissa_bytes=size, **more)
    function, x, y = read(content)
    assert (function.dof, function.kind, function.size) == ("7+Z", 4, 7)
    assert y.dtype == (float if values is REAL else complex)
    np.testing.assert_allclose(x, UNEVEN if uneven else 2.0 + 0.5 * np.arange(7), rtol=1e-12)
    exact = {2: 1e-6, 5: 1e-6, 4: 1e-12, 6: 1e-12}[type_]  # six digits or single; twelve digits
    np.testing.assert_allclose(y, values, rtol=exact)


@pytest.mark.parametrize("binary", [0, 1])
@pytest.mark.parametrize("type_", [2, 4, 5, 6])
@pytest.mark.parametrize("even", [0, 1])
def test_files_of_pyuff(tmp_path, binary, type_, even):
    pyuff = pytest.importorskip("pyuff")
    values = REAL if type_ in (2, 4) else COMPLEX
    path = tmp_path / "other.uff"
    data = {"type": 58, "binary": binary, "func_type": 4, "rsp_node": 7, "rsp_dir": -2}
    data |= {"ref_node": 1, "ref_dir": 3, "ord_data_type": type_, "abscissa_spacing": even}
    data |= {"abscissa_min": 2.0, "abscissa_inc": 0.5, "data": values, "id1": "made"}
    data |= {"orddenom_spec_data_type": 13}
    data |= {"x": 2.0 + 0.5 * np.arange(7) if even else UNEVEN}
    pyuff.UFF(str(path)).write_sets([data], "add")
    with universal_file(path) as file:
        (function,) = file.functions
        x, y = file.values(function)
    assert function.dof == "7-Y"
    np.testing.assert_allclose(x, data["x"], rtol=1e-6)
    np.testing.assert_allclose(y, values, rtol=1e-11)


def test_fortran_exponents(uff, read):
    text = uff.function(7, REAL, type_=4).replace(b"E+", b"D+").replace(b"E-", b"d-")
    np.testing.assert_allclose(read(text)[2], REAL, rtol=1e-12)
    bare = (
        uff.function(7, REAL).replace(b"-4.00000E+08", b"-4.0000-101").replace(b"3E-07", b"3E-07")
    )
    np.testing.assert_allclose(read(bare)[2][3], -4e-101)


def test_columns_without_blanks_between_them(uff, read):
    values = np.array([-1e-100, -2.5e-100, -3e100, -4e-100, -5e-100, -6e-100, -7e-100])
    text = uff.function(7, values)
    assert b"-1.00000E-100-2.50000E-100-3.00000E+100" in text
    np.testing.assert_allclose(read(text)[2], values)


def test_numbers_that_keep_to_no_columns(uff, read):
    lines = uff.header(7, 4, type_=2)
    np.testing.assert_array_equal(
        read(uff.data_set(58, *lines, "1 2", "  3.5", "-4e0"))[2], [1, 2, 3.5, -4]
    )


def test_headers_that_are_not_ascii(uff, opened):
    words = ("Schwingung µm/s é".encode("latin-1"), "振動", "", "", "")
    content = uff.function(7, REAL, words=("a", "b", "c", "d", "e"))
    for old, new in zip((b"\na\n", b"\nb\n"), words, strict=False):
        content = content.replace(
            old, b"\n" + (new if isinstance(new, bytes) else new.encode()) + b"\n"
        )
    content = content.replace(b"Schwinggeschwindig.", b"Schwinggeschwindigk" + b"\xe9")
    with opened(content) as file:
        (function,) = file.functions
        assert function.text[1] == "振動"
        np.testing.assert_allclose(file.values(function)[1], REAL, rtol=1e-6)


@pytest.mark.parametrize("end", [b"\r\n", b" \n", b"\n\n", b"\r"])
def test_line_ends(uff, opened, end):
    content = uff.units() + uff.nodes(PLATE) + uff.function(7, REAL)
    if end == b"\n\n":
        content = content.replace(uff.MARK * 2, uff.MARK + b"\n  \n" + uff.MARK)
    else:
        content = content.replace(b"\n", end)
    with opened(content.rstrip(b"\r\n")) as file:
        assert len(file.entries) == 3
        assert file.geometry.position.shape == (4, 3)
        np.testing.assert_allclose(file.values(file.functions[0])[1], REAL, rtol=1e-6)


def test_lines_that_end_with_cr_alone_around_binary_values(uff, opened):
    values = np.frombuffer(b"\r\n\n\r" * 6 + bytes(8), "<f8")
    content = uff.binary(7, values, type_=4)
    assert values.tobytes() in content
    text = content.replace(values.tobytes(), b"*")
    content = text.replace(b"\n", b"\r").replace(b"*", values.tobytes())
    with opened(content * 2 + uff.nodes(PLATE).replace(b"\n", b"\r")) as file:
        for function in file.functions:
            np.testing.assert_array_equal(file.values(function)[1], values)
        assert file.geometry.position.shape == (4, 3)


def test_marks_of_eighty_columns(uff, read):
    content = uff.binary(7, REAL).replace(uff.MARK, b"    -1" + b" " * 74 + b"\n")
    np.testing.assert_allclose(read(content)[2], REAL, rtol=1e-6)


def test_a_mark_among_binary_values_ends_nothing(uff, opened):
    values = np.frombuffer(b"\n" + uff.MARK * 9, "<f8")
    content = uff.binary(7, values, type_=4) + uff.binary(8, values, type_=4)
    with opened(content) as file:
        assert [f.dof for f in file.functions] == ["7+Z", "8+Z"]
        np.testing.assert_array_equal(file.values(file.functions[1])[1], values)


@pytest.mark.parametrize("claimed", [0, 7 * 4, 10**9])
def test_wrong_number_of_bytes_where_the_header_knows_better(uff, read, claimed):
    np.testing.assert_allclose(read(uff.binary(7, COMPLEX, claimed=claimed))[2], COMPLEX, rtol=1e-6)


@pytest.mark.parametrize("before", [b"\n", b"\r\n"])
def test_a_line_end_after_binary_values(uff, read, before):
    np.testing.assert_allclose(read(uff.binary(7, REAL, before_mark=before))[2], REAL, rtol=1e-6)


def turned(angle, origin=(0.5, -2.0, 3.0)):
    """Axes turned about z, and an origin."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]), np.array(origin)


def test_nodes_in_local_systems(uff, opened):
    axes, origin = turned(0.4)
    content = uff.systems({5: (axes, origin)}) + uff.nodes(PLATE, system=5, motion=5)
    with opened(content) as file:
        geometry = file.geometry
    np.testing.assert_allclose(geometry.position, origin + np.array(PLATE) @ axes)
    np.testing.assert_allclose(geometry.direction(2, -1), -axes[0])
    np.testing.assert_allclose(geometry.direction(2, 3), [0, 0, 1])


def test_data_set_18_is_the_same_system(uff, opened):
    axes, origin = turned(0.4)
    points = [*origin, *(origin + 2 * axes[0]), *(origin + 3 * axes[2] - axes[0])]
    rows = ["".join(f"{v:13.5E}" for v in row) for row in (points[:6], points[6:])]
    content = uff.data_set(18, f"{5:10d}{0:10d}{0:10d}{8:10d}{1:10d}", "CS", *rows)
    with opened(content + uff.nodes_15(PLATE, system=5, motion=5)) as file:
        np.testing.assert_allclose(
            file.geometry.position, origin + np.array(PLATE) @ axes, atol=2e-5
        )


def test_cylindrical_and_spherical_systems(uff, opened):
    axes, origin = turned(0.0)
    for kind, coordinates, own in (
        (1, [2.0, 90.0, 0.5], [[0, 1, 0], [-1, 0, 0], [0, 0, 1]]),
        (2, [2.0, 90.0, 90.0], [[0, 1, 0], [0, 0, -1], [-1, 0, 0]]),
    ):
        content = uff.systems({5: (axes, origin)}, kind=kind)
        with opened(content + uff.nodes([coordinates], system=5, motion=5)) as file:
            z = coordinates[2] if kind == 1 else 0
            np.testing.assert_allclose(
                file.geometry.position[0], origin + np.array([0, 2.0, z]), atol=1e-12
            )
            directions = [file.geometry.direction(0, k) for k in (1, 2, 3)]
            np.testing.assert_allclose(directions, own, atol=1e-12)


def test_elements_and_lines(uff, opened):
    content = uff.nodes(PLATE, first=11) + uff.elements([[11, 12, 13]], kind=91)
    content += uff.elements([[11, 12, 13, 14]]) + uff.trace([11, 12, 0, 13, 14, 11])
    with opened(content) as file:
        geometry = file.geometry
    np.testing.assert_array_equal(geometry.triangles, [[0, 1, 2]])
    np.testing.assert_array_equal(geometry.quadrilaterals, [[0, 1, 2, 3]])
    assert geometry.lines == ((0, 1), (2, 3, 0))


def test_beams_and_solids_are_left_out(uff, opened):
    beam = uff.data_set(
        2412, "".join(f"{v:10d}" for v in (1, 21, 1, 1, 7, 2)), f"{0:10d}" * 3, f"{1:10d}{2:10d}"
    )
    solid = uff.elements([[1, 2, 3, 4]], kind=111)
    with opened(uff.nodes(PLATE) + beam + solid) as file:
        assert file.geometry.triangles.shape == (0, 3)
        assert file.geometry.quadrilaterals.shape == (0, 4)


def test_corners_of_elements_of_second_order(uff, opened):
    positions = [[i, i * i, 0] for i in range(8)]
    content = uff.nodes(positions) + uff.elements([[1, 5, 2, 6, 3, 7, 4, 8]], kind=95)
    with opened(content + uff.elements([[1, 5, 2, 6, 3, 7]], kind=92)) as file:
        np.testing.assert_array_equal(file.geometry.quadrilaterals, [[0, 1, 2, 3]])
        np.testing.assert_array_equal(file.geometry.triangles, [[0, 1, 2]])


def test_units_and_amplitudes(uff, opened):
    with opened(uff.units(0.0254) + uff.qualifiers(0) + uff.qualifiers(3)) as file:
        assert file.units.length == pytest.approx(0.0254, rel=1e-15)
        assert file.amplitude[0] == 3


def test_one_function_is_read_without_the_others(uff, opened):
    functions = [uff.binary(n, np.full(50_000, float(n))) for n in range(1, 30)]
    with opened(b"".join(functions)) as file:
        read_bytes = 0
        plain = file.source._at

        def counted(start, count):
            nonlocal read_bytes
            read_bytes += count
            return plain(start, count)

        file.source._at = counted
        np.testing.assert_array_equal(file.values(file.functions[16])[1], 17.0)
    assert read_bytes < 4 * 50_000 + 29 * (1 << 14) + 1
