"""A universal file that was damaged in one place is read equal, or refused: never other numbers.

No reader can see that ``1.5`` once was ``1.6``. What is promised depends on the file, therefore:

* Files of the program's own writer begin with a seal, a checksum of all lines behind it. There any
  damage of one place is promised to be harmless or refused, also one of a digit.
* Files of other programs have none. There those damages are promised to be harmless or refused
  that break the form: lines that are lost or given twice among values, a file that ends too early,
  marks, counts, types, characters that make no number, a label of another quantity or of none, and
  one function's label of another unit than the others'. A digit of a number, the sign of a value,
  two values exchanged, and the label of all functions alike, are not among them.
"""

from __future__ import annotations

import io
import re
from collections import Counter

import numpy as np
import pytest

from sldvexp.errors import UserError
from sldvexp.importers import PointwiseView, conventions
from sldvexp.importers.uff import UffImport
from sldvexp.io.uff import writer
from sldvexp.io.uff.seal import SealedWriter

POINTS = np.array([[0, 0, 0], [0.3, 0, 0], [0.3, 0.2, 0.01], [0, 0.2, 0]])
RNG = np.random.default_rng(12)
V = 1e-3 * (RNG.normal(size=(4, 3, 5)) + 1j * RNG.normal(size=(4, 3, 5)))
EVEN = 100.0 + 10.0 * np.arange(5)
UNEVEN = np.array([100.0, 110.0, 125.0, 130.0, 150.0])
ABOUT = ["Velocity, m/s", "peak amplitude, exp(+i omega t)", "", "made by a test", ""]
SAID = {
    "directions": conventions.Directions.dof,
    "phase": conventions.Phase.exp_plus,
    "amplitude": None,
}


def pieces(frequency=EVEN):
    """Data sets as the export writes them: geometry, shapes, spectra of every node along Z."""
    world = np.ones(len(POINTS), int)
    made = [
        writer.units(),
        writer.systems(np.empty((0, 3, 3))),
        writer.nodes(POINTS, world),
        writer.elements(np.empty((0, 6), int), np.array([[0, 1, 2], [0, 2, 3]])),
        writer.shape(ABOUT, V[..., 0], frequency[0], 1, writer.RESPONSE),
        writer.qualifiers(),
    ]
    for node in range(len(POINTS)):
        values = V[node, 2]
        made.append(writer.function(ABOUT, node + 1, node + 1, 3, frequency, values))
    return made


def sealed(frequency=EVEN):
    text = io.StringIO()
    with SealedWriter(text) as file:
        file.writelines(pieces(frequency))
    return text.getvalue().encode()


def bare(frequency=EVEN):
    return "".join(pieces(frequency)).encode()


def read(path, content):
    """Everything that an import makes of a file."""
    path.write_bytes(content)
    group = UffImport(views={"a": PointwiseView(path=str(path))}, **SAID).read()
    arrays = {str(name): group[name].values for name in group.variables}
    # The place of a data set in the file is no convention.
    told = {k: re.sub(r"data set \d+ ", "", v) for k, v in group.attrs.items()}
    return arrays, {k: v for k, v in told.items() if k.startswith("import_")}


def same(one, two):
    return (
        one[1] == two[1]
        and one[0].keys() == two[0].keys()
        and all(np.array_equal(one[0][name], two[0][name]) for name in one[0])
    )


# Damages of one place; each takes the content and a source of random numbers.


def changed_byte(content, rng):
    at = int(rng.integers(len(content)))
    new = bytes([int(rng.integers(256))])
    return content[:at] + new + content[at + 1 :]


def changed_digit(content, rng):
    places = np.flatnonzero(
        np.isin(np.frombuffer(content, np.uint8), np.frombuffer(b"0123456789", np.uint8))
    )
    at = int(rng.choice(places))
    new = b"0123456789".replace(content[at : at + 1], b"")[int(rng.integers(9))]
    return content[:at] + bytes([new]) + content[at + 1 :]


def lost_byte(content, rng):
    at = int(rng.integers(len(content)))
    return content[:at] + content[at + 1 :]


def added_byte(content, rng):
    at = int(rng.integers(len(content)))
    return content[:at] + bytes([int(rng.integers(256))]) + content[at:]


def cut(content, rng):
    return content[: int(rng.integers(1, len(content)))]


def block(content, rng):
    """A block of zeros, as of a bad sector."""
    at = int(rng.integers(len(content)))
    length = int(rng.integers(1, 200))
    return content[:at] + bytes(len(content[at : at + length])) + content[at + length :]


def _lines(content, rng, work):
    lines = content.splitlines(keepends=True)
    at = int(rng.integers(len(lines) - 1))
    work(lines, at)
    return b"".join(lines)


def lost_line(content, rng):
    return _lines(content, rng, lambda lines, at: lines.pop(at))


def doubled_line(content, rng):
    return _lines(content, rng, lambda lines, at: lines.insert(at, lines[at]))


def exchanged_lines(content, rng):
    def work(lines, at):
        lines[at], lines[at + 1] = lines[at + 1], lines[at]

    return _lines(content, rng, work)


def exchanged_columns(content, rng):
    def work(lines, at):
        words = lines[at].split()
        if len(words) > 1:
            i, j = rng.choice(len(words), 2, replace=False)
            words[i], words[j] = words[j], words[i]
            lines[at] = b"".join(b" %24s" % word for word in words) + b"\n"

    return _lines(content, rng, work)


def lost_set(content, rng):
    return _sets(content, rng, lambda sets, at: sets.pop(at))


def doubled_set(content, rng):
    return _sets(content, rng, lambda sets, at: sets.insert(at, sets[at]))


def _sets(content, rng, work):
    parts = content.split(b"    -1\n")
    sets = [b"    -1\n" + part + b"    -1\n" for part in parts[1::2]]
    work(sets, int(rng.integers(len(sets))))
    return b"".join(sets)


LABELS = (b"mm/s", b"um/s", b"m", b"m/s^2", b"V", b"ips", b"g", b"\xb5m/s", b"dB", b"mm/s rms", b"")


def changed_label(content, rng):
    """The unit of one function."""
    places = [i for i in range(len(content)) if content.startswith(b"Velocity             m/s ", i)]
    at = int(rng.choice(places)) + 21
    new = LABELS[int(rng.integers(len(LABELS)))]
    return content[:at] + new.ljust(20) + content[at + 20 :]


ANY = (
    *(changed_byte, changed_digit, lost_byte, added_byte, cut, block),
    *(lost_line, doubled_line, exchanged_lines, exchanged_columns),
    *(lost_set, doubled_set, changed_label),
)


def outcome(path, content, sound, damage, rng):
    """Damage a file and read it: harmless, refused, or other numbers."""
    damaged = damage(content, rng)
    try:
        found = read(path, damaged)
    except UserError as error:
        assert "\n" not in error.args[0]  # noqa: PT017
        return "refused"
    return "equal" if same(found, sound) else "other"


def try_all(path, content, damages, trials, seed):
    """Count what becomes of so many damages of each kind."""
    rng = np.random.default_rng(seed)
    sound = read(path, content)
    count = Counter()
    for damage in damages:
        for _ in range(trials):
            found = outcome(path, content, sound, damage, rng)
            count[found] += 1
            assert found != "other", f"{damage.__name__}: {path.read_bytes()[:200]!r}"
    return count


@pytest.mark.one_in(2)
@pytest.mark.parametrize("frequency", [EVEN, UNEVEN], ids=["even", "uneven"])
def test_any_damage_of_a_file_of_ours_is_harmless_or_refused(tmp_path, frequency):
    content = sealed(frequency)
    count = try_all(tmp_path / "a.uff", content, ANY, 30, seed=5)
    assert count.total() == 30 * len(ANY)
    assert count["refused"] > 0.8 * count.total()


@pytest.mark.long
def test_thousands_of_damages_of_files_of_ours(tmp_path):
    count = Counter()
    for frequency in (EVEN, UNEVEN):
        count += try_all(tmp_path / "a.uff", sealed(frequency), ANY, 300, seed=6)
    assert count.total() == 7800, count


# Files without a seal: damages of the form.


def functions_of(content):
    """The lines, and of each function the marks that begin and end it."""
    lines = content.splitlines(keepends=True)
    marks = [i for i, line in enumerate(lines) if line == b"    -1\n"]
    pairs = zip(marks[::2], marks[1::2], strict=True)
    return lines, [(a, b) for a, b in pairs if lines[a + 1].strip() == b"58"]


def _of_values(content, rng, work):
    lines, sets = functions_of(content)
    first, last = sets[int(rng.integers(len(sets)))]
    work(lines, int(rng.integers(first + 13, last)))
    return b"".join(lines)


def lost_values(content, rng):
    return _of_values(content, rng, lambda lines, at: lines.pop(at))


def doubled_values(content, rng):
    return _of_values(content, rng, lambda lines, at: lines.insert(at, lines[at]))


def no_number(content, rng):
    """A strange character in a number."""

    def work(lines, at):
        digits = [i for i, byte in enumerate(lines[at]) if byte in b"0123456789"]
        i, strange = int(rng.choice(digits)), int(rng.choice(list(b"xOl?*#\xb5_/:")))
        lines[at] = lines[at][:i] + bytes([strange]) + lines[at][i + 1 :]

    return _of_values(content, rng, work)


def _of_shape(content, rng, work):
    """Change type, number and spacing of the values in the header of a function."""
    lines, sets = functions_of(content)
    at = sets[int(rng.integers(len(sets)))][0] + 8
    numbers = [int(lines[at][i : i + 10]) for i in (0, 10, 20)]
    lines[at] = b"%10d%10d%10d" % tuple(work(*numbers)) + lines[at][30:]
    return b"".join(lines)


def wrong_count(content, rng):
    wrong = int(rng.choice([0, 1, 2, 3, 4, 6, 7, 9, 50, 10**6]))
    return _of_shape(content, rng, lambda type_, count, spacing: (type_, wrong, spacing))


def wrong_type(content, rng):
    wrong = int(rng.choice([2, 4, 1, 3, 7]))
    return _of_shape(content, rng, lambda type_, count, spacing: (wrong, count, spacing))


def wrong_spacing(content, rng):
    return _of_shape(content, rng, lambda type_, count, spacing: (type_, count, 1 - spacing))


NO_MARKS = (b"     1\n", b"    - 1\n", b"   -1\n", b"    -11\n", b"\n", b"     -1\n", b"    -1x\n")


def broken_mark(content, rng):
    lines = content.splitlines(keepends=True)
    at = int(rng.choice([i for i, line in enumerate(lines) if line == b"    -1\n"]))
    lines[at] = NO_MARKS[int(rng.integers(len(NO_MARKS)))]
    return b"".join(lines)


def moved_header(content, rng):
    """One line of a function's header lost or given twice."""
    lines, sets = functions_of(content)
    at = sets[int(rng.integers(len(sets)))][0] + 2 + int(rng.integers(11))
    if rng.integers(2):
        lines.pop(at)
    else:
        lines.insert(at, lines[at])
    return b"".join(lines)


FORM = (
    *(cut, lost_values, doubled_values, no_number),
    *(wrong_count, wrong_type, wrong_spacing, changed_label),
)


@pytest.mark.whole
@pytest.mark.parametrize("frequency", [EVEN, UNEVEN], ids=["even", "uneven"])
def test_damage_of_the_form_of_any_file_is_harmless_or_refused(tmp_path, frequency):
    content = bare(frequency)
    count = try_all(tmp_path / "a.uff", content, FORM, 30, seed=7)
    assert count["refused"] > 0.9 * count.total()


@pytest.mark.parametrize("damage", [broken_mark, moved_header])
def test_function_that_is_lost_by_its_form_is_never_read_as_another(tmp_path, damage):
    """A mark that is none joins two data sets: a function may be lost, but no number changes."""
    content, rng = bare(), np.random.default_rng(8)
    path = tmp_path / "a.uff"
    sound, _ = read(path, content)
    for _ in range(60):
        try:
            found, _ = read(path, damage(content, rng))
        except UserError:
            continue
        place = [sound["point"].tolist().index(p) for p in found["point"]]
        np.testing.assert_array_equal(found["velocity"], sound["velocity"][:, place])
        np.testing.assert_array_equal(found["position"], sound["position"][place])


@pytest.mark.long
def test_thousands_of_damages_of_the_form(tmp_path):
    count = Counter()
    for frequency in (EVEN, UNEVEN):
        count += try_all(tmp_path / "a.uff", bare(frequency), FORM, 200, seed=9)
    assert count.total() == 3200, count
