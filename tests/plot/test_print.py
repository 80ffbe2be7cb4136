"""Figures in print: letters of their size, apart and inside, in the files that a journal takes."""

from __future__ import annotations

import itertools
import re
import zlib

import matplotlib
import numpy as np
import pytest
from matplotlib.backends.backend_agg import RendererAgg
from matplotlib.text import Text

import sldvexp.plot
from sldvexp import dataset
from sldvexp.errors import UserError
from sldvexp.plot import figures_of
from sldvexp.plot.style import runs_of
from tests.plot import groups_of_runs as groups
from tests.report.made_modes import criteria, modes
from tests.shell.made_strain import made_strain

#: Modes, Hz, whose numbers would lie over one another.
CLOSE = np.array([197.0, 201.0, 203.0, 439.0, 440.0, 545.0])
COLUMN, PAGE = 0.085, 0.18
SMALLEST = 6.5
#: Every figure, and the run of the session or made groups that it is drawn of.
OF_SESSION = (
    *("edges", "conics", "conic_residuals", "bitangents", "pose_residuals", "phase_correction"),
    *("images", "volume", "field", "surface", "nodal", "residuals"),
)
OF_GROUPS = (
    *("point", "spectrum", "few", "repeatability", "sweep", "strain", "hot_spots", "points"),
    *("stabilisation", "close_modes", "model_criteria"),
)


def drawn_texts(figure):
    """Take every text that is drawn with its size, points, and its box, dots."""
    found, draw = {}, Text.draw

    def recorded(self, renderer, *args, **options):
        if self.get_visible() and self.get_text().strip():
            box = self.get_window_extent(renderer)  # one number is drawn at every place of its kind
            found[self.get_text(), *box.min] = (self.get_text(), self.get_size(), box)
        return draw(self, renderer, *args, **options)

    width, height = figure.get_size_inches() * figure.dpi
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Text, "draw", recorded)
        figure.draw(RendererAgg(width, height, figure.dpi))
    return list(found.values())


def faults_of(figure):
    """Tell which texts are too small, cut off, or over others."""
    texts = drawn_texts(figure)
    width, height = figure.get_size_inches() * figure.dpi
    faults = [f"{text!r} has {size} points" for text, size, _ in texts if size < SMALLEST]
    for text, _, box in texts:
        if min(box.x0, box.y0) < -1 or box.x1 > width + 1 or box.y1 > height + 1:
            faults.append(f"{text!r} is cut off")
    for (one, _, a), (other, _, b) in itertools.combinations(texts, 2):
        across, up = min(a.x1, b.x1) - max(a.x0, b.x0), min(a.y1, b.y1) - max(a.y0, b.y0)
        if across > 1 and up > 1:
            faults.append(f"{one!r} lies over {other!r}")
    return faults


def spectra(count):
    """A field of one node at many frequencies."""
    hertz = np.linspace(50.0, 500.0, count)
    rng = np.random.default_rng(2)
    velocity = 0.01 * (rng.normal(size=(6, 3, count)) + 1j * rng.normal(size=(6, 3, count)))
    bound = np.full(velocity.shape, 1e-3)
    return dataset.group(
        "field",
        {"frequency": hertz},
        velocity=velocity,
        confidence=bound,
        position=np.zeros((6, 3)),
        element=[[0, 1, 2, 3, 4, 5]],
    )


def drawing_of(name, tree):
    """Find what draws a figure of the session or of made groups."""
    if name in OF_SESSION:
        return figures_of(tree)[name]
    made = {
        "point": lambda: ("point", {"point": groups.point(1), "compare/other": groups.point(2)}),
        "spectrum": lambda: ("spectrum", {"field": spectra(40)}),
        "few": lambda: ("spectrum", {"field": spectra(3)}),
        "repeatability": lambda: (
            "repeatability",
            groups.repeats(np.random.default_rng(0).uniform(-1000, 1000, (16, 2))),
        ),
        "sweep": lambda: ("sweep", groups.sweep()),
        "strain": lambda: ("strain", {"strain": strain()}),
        "hot_spots": lambda: ("hot_spots", {"strain": strain()}),
        "stabilisation": lambda: ("stabilisation", {"modes": modes()}),
        "model_criteria": lambda: ("model_criteria", criteria()),
        "close_modes": lambda: ("stabilisation", {"modes": modes(CLOSE)}),
        "points": lambda: ("surface", {"point": groups.points(), "line_of_sight": groups.joined()}),
    }
    figure, of = made[name]()
    return lambda **options: getattr(sldvexp.plot, figure)(of, **options)


def strain():
    from sldvexp.volume import Grid

    grid = Grid(center=[0.4, 0.1, 0], size=[0.3, 0.2], shape=[13, 9], layers=2)
    return made_strain(grid.group())


@pytest.mark.whole
@pytest.mark.parametrize("width", [COLUMN, PAGE])
@pytest.mark.parametrize("name", [*OF_SESSION, *OF_GROUPS])
def test_letters_are_large_enough_inside_and_apart(tree, name, width):
    figure = drawing_of(name, tree)(width=width)
    assert figure.get_figwidth() * 0.0254 == pytest.approx(width)
    assert len(drawn_texts(figure)) > 4
    assert faults_of(figure) == []


def five_digits(centre):
    """Edges of three circles in steps of a board of 16 bits, around the corner of its range."""
    turn = np.linspace(0.0, 6.0, 12)
    out = np.column_stack([np.sin(turn), np.cos(turn)])
    dac = [np.add(centre, [4000 * k, 5000 * k]) + 800 * out for k in range(3)]
    one = np.ones(36)
    edge = dataset.group(
        "edge",
        {},
        dac=np.concatenate(dac),
        dac_std=0.1 * one,
        direction=np.tile(out, (3, 1)),
        width=2 * one,
        phase=0 * one,
        circle=np.repeat([1, 2, 3], 12),
    )
    edge.attrs["summary"] = "\n".join(f"circle {k}: 12 edges" for k in (1, 2, 3))
    return edge


@pytest.mark.whole
@pytest.mark.one_in(4)
@pytest.mark.parametrize("width", [COLUMN, PAGE])
@pytest.mark.parametrize("name", ["edges", "conics"])
def test_numbers_of_five_digits_do_not_run_together(name, width):
    corners = ((-18000, -19000), (-18000, 9000), (10000, 9000))
    tree = {f"edge/{k}": five_digits(corner) for k, corner in enumerate(corners)}
    figure = getattr(sldvexp.plot, name)(tree, width=width)
    assert faults_of(figure) == []
    numbers = [t for t in drawn_texts(figure) if re.fullmatch(r"−?\d{4,5}", t[0])]
    assert len(numbers) > 6
    for (one, size, a), (other, _, b) in itertools.combinations(numbers, 2):
        beside = min(a.y1, b.y1) > max(a.y0, b.y0)
        gap = max(a.x0, b.x0) - min(a.x1, b.x1)
        letter = size * figure.dpi / 72 / 2
        assert not beside or gap > 0.6 * letter, (one, other)


def test_the_measure_finds_letters_that_are_small_cut_off_or_over_others():
    figure = sldvexp.plot.point({"point": groups.point(1)})
    figure.text(0.5, 0.5, "one")
    figure.text(0.5, 0.5, "other", fontsize=6.0)
    figure.text(0.99, 0.5, "a long text at the edge")
    assert len(faults_of(figure)) >= 3


@pytest.mark.whole
def test_letters_stay_letters(tmp_path):
    figure = sldvexp.plot.point({"point": groups.point(1)}, width=COLUMN)
    svg, pdf = sldvexp.plot.save(figure, tmp_path / "point", formats=["svg", "pdf"])
    text = svg.read_text()
    assert "<text" in text
    assert "real, mm/s" in text
    assert 'width="240.9' in text  # points of 85 mm
    data = pdf.read_bytes()
    parts = [
        zlib.decompress(m) for m in re.findall(rb"stream\r?\n(.*?)\r?\nendstream", data, re.S)[:1]
    ]
    assert b"/FontFile2" in data or b"/Type0" in data  # TrueType, not outlines of letters
    assert any(re.search(rb"T[jJ]", part) for part in parts)
    again = sldvexp.plot.save(figure, tmp_path / "again", "point", ["pdf"])
    assert again[0].read_bytes() == data


@pytest.mark.whole
def test_a_style_of_ones_own_stands_over_ours(tmp_path):
    tree = {"point": groups.point(1)}
    file = tmp_path / "mine.mplstyle"
    file.write_text("font.size: 10\naxes.labelsize: 10\nlines.linewidth: 3\n")
    for style in (file, {"axes.labelsize": 10.0}):
        figure = sldvexp.plot.point(tree, style=style)
        assert figure.axes[0].yaxis.label.get_fontsize() == 10.0
    assert sldvexp.plot.point(tree).axes[0].yaxis.label.get_fontsize() == 8.0
    for wrong in (tmp_path / "none.mplstyle", {"no.such": 1}):
        with pytest.raises(UserError, match="is no style of matplotlib"):
            sldvexp.plot.point(tree, style=wrong)
    with pytest.raises(UserError, match="60 to 1000 mm wide"):
        sldvexp.plot.point(tree, width=0.001)


@pytest.mark.whole
def test_the_command_takes_width_format_resolution_and_style(sldvexp, tmp_path):
    dataset.save({"point": groups.point(1)}, {}, tmp_path / "run.nc")
    words = ["--width", "85mm", "--format=pdf,png", "--dpi", "100"]
    done = sldvexp("plot", str(tmp_path), "point", *words)
    assert done.status == 0, done.err
    png = tmp_path / "figures" / "point.png"
    assert sorted(p.name for p in png.parent.iterdir()) == ["point.pdf", "point.png"]
    assert matplotlib.image.imread(png).shape[1] == pytest.approx(85 / 25.4 * 100, abs=1)


@pytest.mark.parametrize(
    ("option", "said"),
    [
        ("--width=85", "--width=85: is no length; give a number with its unit, as 85mm"),
        ("--width=3m", "60 to 1000 mm wide"),
        ("--format=pgn", "there is no such format; did you mean png"),
        ("--dpi=1e9", "must be a number from 20 to 2400"),
        ("--style=none", "style none: is no style of matplotlib"),
    ],
)
def test_the_command_refuses_wrong_options_in_one_sentence(sldvexp, tmp_path, option, said):
    dataset.save({"point": groups.point(1)}, {}, tmp_path / "run.nc")
    done = sldvexp("plot", str(tmp_path), option)
    assert done.status == 1
    assert said in done.err
    assert done.err.count("\n") == 1
    assert not (tmp_path / "figures").exists()


def test_two_far_lines_are_not_joined():
    figure = sldvexp.plot.spectrum({"field": spectra(3)}, node=0)
    assert all(len(line.get_xdata()) == 1 for line in figure.axes[0].lines)
    joined = sldvexp.plot.spectrum({"field": spectra(40)}, node=0)
    assert len(joined.axes[0].lines[0].get_xdata()) == 40
    assert runs_of(np.geomspace(10.0, 1000.0, 20)) == [slice(0, 20)]


def test_a_frequency_that_the_run_does_not_have_is_said():
    of = {"field": spectra(40), "volume": dataset.group("volume", {}, depth=[0.0, 0.01])}
    of["field"]["position"].values[:] = [
        [x, y, z] for z in (0, 0.01) for x, y in ((0, 0), (1, 0), (0, 1))
    ]
    of["field"] = of["field"].assign(observable=(("node", "component"), np.ones((6, 3), int)))
    told = sldvexp.plot.field(of, frequency=100.0).get_suptitle()
    assert "96.1538 Hz, the nearest to 100 Hz" in told.replace("\n", " ")
    assert "nearest" not in sldvexp.plot.field(of, frequency=50.0).get_suptitle()
