"""Broken and hostile universal files are refused in one sentence with data set and line or byte."""

from __future__ import annotations

import re
import tracemalloc
from types import SimpleNamespace

import numpy as np
import pytest

from sldvexp.errors import UserError
from sldvexp.io.uff import universal_file

PLATE = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
VALUES = np.array([1 + 2j, 3 - 4j, 5 + 6j, -7 + 8j, 9.5 - 10j])
#: Enough for a small file and what Python itself needs, bytes.
ENOUGH = 4 << 20


def read_all(path):
    """Everything that is in a file."""
    with universal_file(path) as file:
        assert file.units is None or file.units.length > 0
        _ = file.geometry, file.amplitude
        return [file.values(function) for function in file.functions]


def line(content, number, old, new):
    """The content with a change in one of its lines, counted from 1."""
    lines = content.split(b"\n")
    assert old in lines[number - 1]
    lines[number - 1] = lines[number - 1].replace(old, new)
    return b"\n".join(lines)


def without(content, *numbers):
    lines = content.split(b"\n")
    return b"\n".join(line for i, line in enumerate(lines, 1) if i not in numbers)


#: Values of nothing but line feeds, which a transfer as text doubles.
FEEDS = np.frombuffer(bytes([10] * 40), "<f4").astype(float)


@pytest.fixture(scope="module")
def made(uff):
    """The writer, and sound files."""
    raw, values = uff.binary(7, VALUES), 8 * len(VALUES)
    return SimpleNamespace(
        **vars(uff),
        text=uff.function(7, VALUES),
        double=uff.function(7, VALUES, type_=6),
        raw=raw,
        start=len(raw) - len(uff.MARK) - values,
        plate=uff.nodes(PLATE),
    )


#: What is made of sound files, and what the message must say after the path.
BROKEN = {
    # markers and identifiers
    "empty": (lambda m: b"", "is empty"),
    "blank": (lambda m: b"  \n\n   \n", "is empty"),
    "other_text": (lambda m: b"view,dx,dy,dz\n1,2,3,4\n", "line 1: is not a universal file"),
    "other_binary": (lambda m: bytes(range(256)) * 8, "line 1: is not a universal file"),
    "zeros": (lambda m: bytes(4096), "is empty"),
    "no_number": (
        lambda m: m.MARK + b"  abc\n" + m.MARK,
        "data set 1 (unknown), line 2: must begin with",
    ),
    "only_mark": (lambda m: m.MARK, "data set 1 (unknown), line 2: must begin with"),
    "not_closed": (
        lambda m: m.plate[: -len(m.MARK)],
        "data set 1 (2411), line 10: the file ends before",
    ),
    "second_not_closed": (lambda m: m.plate + m.text[:-8], "data set 2 (58), line"),
    "between": (
        lambda m: m.plate + b"hello\n" + m.text,
        "data set 1 (2411), line 12: after the end of",
    ),
    "binary_2411": (
        lambda m: line(m.plate, 2, b"  2411", b"  2411b"),
        "data set 1 (2411b), line 2: only",
    ),
    # m.text functions
    "header_cut": (
        lambda m: m.data_set(58, *m.header(7, 5)[:6]),
        "data set 1 (58), line 8: the header",
    ),
    "dof_letters": (
        lambda m: line(m.text, 8, b"         7", b"       7x7"),
        "line 8: must hold the function",
    ),
    "dof_unknown": (lambda m: line(m.text, 8, b"   3", b"  33"), "line 8: must hold the function"),
    "type_of_values": (
        lambda m: line(m.text, 9, b"         5", b"         3"),
        "line 9: the type of the val",
    ),
    "spacing": (
        lambda m: line(m.text, 9, b"         1", b"         2"),
        "line 9: the spacing of the",
    ),
    "no_values": (lambda m: m.function(7, VALUES[:0]), "line 9: there must be at least one value"),
    "negative_count": (
        lambda m: line(m.text, 9, b"         5         5", b"         5        -5"),
        "line 9",
    ),
    "no_increment": (lambda m: m.function(7, VALUES, step=0.0), "line 9: the even abscissa"),
    "claims_more": (
        lambda m: line(m.text, 9, b"         5         5", b"         5        50"),
        "data set 1 (58), line 14: the header claims 50 values",
    ),
    "claims_one_more": (
        lambda m: line(m.text, 9, b"         5         5", b"         5         6"),
        "data set 1 (58), line 14: the header claims 12 numbers, but there are fewer: 10",
    ),
    "claims_fewer": (
        lambda m: line(m.text, 9, b"         5         5", b"         5         4"),
        "data set 1 (58), line 14: the header claims 8 numbers, but there are more: 10",
    ),
    "claims_huge": (
        lambda m: line(m.text, 9, b"         5         5", b"         59999999999"),
        "data set 1 (58), line 14: the header claims 9999999999 values",
    ),
    "truncated_values": (lambda m: without(m.text, 15), "line 14: the header claims 10 numbers"),
    "overflow": (
        lambda m: line(m.text, 14, b"  1.00000E+00", b"*************"),
        "line 14: '*************'",
    ),
    "nan": (lambda m: line(m.text, 14, b"  1.00000E+00", b"          nan"), "line 14"),
    "letters": (
        lambda m: line(m.text, 15, b"-7.00000E+00", b"-7.O0000E+00"),
        "line 15: '-7.O0000E+00' in col",
    ),
    "underscore": (
        lambda m: line(m.text, 14, b"1.00000E+00", b"1_0.000E+00"),
        "line 14: '1_0.000E+00'",
    ),
    "fused_shifted": (lambda m: line(m.text, 14, b"  2.00000E+00", b"2.00000E+00-"), "line 14"),
    "comma": (lambda m: line(m.text, 14, b"1.00000E+00", b"1,00000E+00"), "line 14: '1,00000E+00'"),
    "beyond_column": (
        lambda m: line(m.double, 14, b"2.000000000000E+00", b"-2.000000000000E+00x0"),
        "line 14",
    ),
    "after_binary": (
        lambda m: m.raw + line(m.text, 9, b"         5", b"         3"),
        "data set 2 (58), byte ",
    ),
    # binary functions
    "truncated": (lambda m: m.raw[:-20], "data set 1 (58b), byte 449: its header claims 40 bytes"),
    "truncated_header": (lambda m: m.raw[:300], "data set 1 (58b)"),
    "count_and_bytes": (
        lambda m: m.binary(7, VALUES, claimed=800).replace(
            b"         5         5", b"         5       100"
        ),
        "its header claims 800 bytes of values, but only",
    ),
    "binary_count": (
        lambda m: m.raw.replace(b"         5         5", b"         5       100"),
        "the header claims 100 values of 8 bytes, but there are 40 bytes",
    ),
    "crlf_in_values": (
        lambda m: m.binary(7, FEEDS).replace(b"\n", b"\r\n"),
        "CR LF stands where the values have LF",
    ),
    "byte_order": (
        lambda m: line(m.raw, 2, b"b     1", b"b     3"),
        "line 2: the byte order must be 1 or 2",
    ),
    "vax_numbers": (
        lambda m: line(m.raw, 2, b"     1     2", b"     1     1"),
        "data set 1 (58b), line 2: its values are VAX floating-point numbers (format 1), and only",
    ),
    "ibm_numbers": (
        lambda m: m.plate + line(m.raw, 2, b"     1     2", b"     1     3"),
        "data set 2 (58b), line 13: its values are IBM floating-point numbers (format 3), and only",
    ),
    "cr_alone_and_no_number": (
        lambda m: line(m.text, 14, b"E", b"X").replace(b"\n", b"\r"),
        "data set 1 (58), line 14",
    ),
    "lines_of_header": (
        lambda m: line(m.raw, 2, b"          11", b"          12"),
        "line 2: the header must",
    ),
    "binary_fields": (
        lambda m: line(m.raw, 2, b"          40", b"          xx"),
        "line 2: must state byte",
    ),
    "binary_infinity": (
        lambda m: m.raw[: m.start] + np.float32(np.inf).tobytes() + m.raw[m.start + 4 :],
        "data set 1 (58b), byte 449: value 1 is not a finite number",
    ),
    "mark_too_early": (
        lambda m: m.raw[:-30] + m.MARK,
        "claims 40 bytes of values, but only 24 are left",
    ),
    # geometry
    "node_twice": (
        lambda m: m.plate + m.nodes(PLATE, first=4),
        "data set 2 (2411), line 14: the node 4 is",
    ),
    "node_twice_15": (
        lambda m: m.nodes_15(PLATE) + m.nodes_15(PLATE[::-1]),
        "data set 2 (15), line 10: the node 1 is given twice",
    ),
    "node_nan": (
        lambda m: m.nodes([[0, np.nan, 0]]),
        "data set 1 (2411), line 4: coordinates of node 1",
    ),
    "node_cut": (
        lambda m: without(m.plate, 10),
        "data set 1 (2411), line 9: ends before coordinates of node 4",
    ),
    "node_text": (
        lambda m: line(m.plate, 5, b"         2", b"       two"),
        "line 5: label and coordinate",
    ),
    "node_fused": (
        lambda m: line(m.nodes_15(PLATE), 4, b" 1.00000E+00", b"1.000000E+0011"),
        "line 4: a node",
    ),
    "no_nodes": (lambda m: m.nodes([]), "data set 1 (2411), line 3: has no nodes"),
    "system_missing": (
        lambda m: m.nodes(PLATE, motion=5),
        "line 3: the node 1 is in coordinate system 5",
    ),
    "system_skew": (
        lambda m: m.systems({5: ([[1, 0, 0], [1, 1, 0], [0, 0, 1]], [0, 0, 0])}) + m.plate,
        "data set 1 (2420), line 10: the axes of coordinate system 5 are not orthonormal",
    ),
    "system_twice": (
        lambda m: b"".join(m.systems({5: (np.eye(3), [x, 0, 0])}) for x in (0, 1)) + m.plate,
        "data set 2 (2420), line 21: the coordinate system 5 is given twice",
    ),
    "system_type": (
        lambda m: m.systems({5: (np.eye(3), [0, 0, 0])}, kind=7) + m.plate,
        "line 5: the type of",
    ),
    "system_cut": (
        lambda m: without(m.systems({5: (np.eye(3), [0, 0, 0])}), 10) + m.plate,
        "data set 1 (2420), line 9: ends before a row of the coordinate system",
    ),
    "system_18_line": (
        lambda m: (
            m.data_set(18, f"{5:10d}{0:10d}{0:10d}{8:10d}{1:10d}", "CS", "0 0 0 1 0 0", "2 0 0")
            + m.plate
        ),
        "data set 1 (18), line 6: the three points of coordinate system 5 lie on a line",
    ),
    "system_18_refers": (
        lambda m: (
            m.data_set(18, f"{5:10d}{0:10d}{9:10d}{8:10d}{1:10d}", "CS", "0 0 0 1 0 0", "0 0 1")
            + m.plate
        ),
        "data set 1 (18), line 3: the coordinate system 5 refers to 9",
    ),
    "element_node": (
        lambda m: m.plate + m.elements([[1, 2, 3, 9]]),
        "line 15: the element 1 names the node 9",
    ),
    "element_same": (
        lambda m: m.plate + m.elements([[1, 2, 2, 3]]),
        "line 15: the element 1 has one node twice",
    ),
    "element_claims": (
        lambda m: m.plate + line(m.elements([[1, 2, 3, 4]]), 3, b"         4", b"  40000000"),
        "data set 2 (2412), line 14: the element 1 claims 40000000 nodes",
    ),
    "element_cut": (
        lambda m: m.plate + without(m.elements([[1, 2, 3, 4]]), 4),
        "line 14: the element 1 claims 4 nodes",
    ),
    "line_node": (
        lambda m: m.plate + m.trace([1, 2, 9]),
        "data set 2 (82), line 16: the line 1 names the node 9",
    ),
    "line_claims": (
        lambda m: m.plate + line(m.trace([1, 2]), 3, b"         2", b" 999999999"),
        "data set 2 (82), line 15: the line 1 claims 999999999 nodes",
    ),
    # units and scales
    "units_zero": (
        lambda m: m.units().replace(b"1.00000", b"0.00000") + m.text,
        "data set 1 (164), line 4",
    ),
    "units_text": (
        lambda m: m.data_set(164, "1 SI", "abc") + m.text,
        "data set 1 (164), line 4: the factors",
    ),
    "units_mixed": (
        lambda m: m.units(1.0) + m.units(1e-3) + m.text,
        "data set 2 (164), line 10: states one un",
    ),
    "amplitude_unknown": (
        lambda m: m.qualifiers(7) + m.text,
        "line 4: the scale of amplitudes must be",
    ),
    "amplitude_mixed": (
        lambda m: m.qualifiers(2) + m.qualifiers(3),
        "data set 2 (1858), line 14: states",
    ),
}


def test_there_are_forty_of_them_and_more():
    assert len(BROKEN) >= 40


@pytest.mark.parametrize("name", BROKEN)
def test_broken_file_is_refused_where_it_is_broken(name, made, tmp_path):
    make, said = BROKEN[name]
    path = tmp_path / f"{name}.uff"
    path.write_bytes(make(made))
    tracemalloc.start()
    with pytest.raises(UserError) as error:
        read_all(path)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    message = str(error.value)
    assert said in message, message
    assert message.startswith(str(path))
    placed = re.search(
        r", data set \d+ \(\w+\), (line|byte) \d+: |, line \d+: |: is empty", message
    )
    assert placed, message
    assert "\n" not in message
    assert peak < ENOUGH
