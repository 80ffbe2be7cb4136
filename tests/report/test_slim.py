"""Figures of a page look the same in fewer characters."""

from __future__ import annotations

import base64
import html
import io
import re

import matplotlib
import numpy as np
import pytest
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from PIL import Image

from sldvexp.report.html.slim import shortened, slim

PICTURE = r"data:image/[^\"]+"


@pytest.fixture(autouse=True, scope="module")
def salted():
    """Names of parts are the same of the same figure."""
    look = {"svg.hashsalt": "sldvexp", "svg.fonttype": "none", "font.family": "DejaVu Sans"}
    with matplotlib.rc_context(look):
        yield


def drawn():
    """A figure with curves, markers, words and a picture of a gradient."""
    made = Figure(figsize=(4, 3), layout="constrained")
    axes = made.subplots(1, 2)
    axes[0].plot(np.linspace(0, 1, 200), np.linspace(0, 1, 200) ** 2, marker="o")
    axes[0].set_title('of 0.123456 <mm> & d="M 0.98765"')
    axes[1].imshow(np.outer(*2 * [np.sin(np.linspace(0, 3, 300))]), interpolation="bilinear")
    return made


@pytest.fixture(scope="module")
def svg(salted):
    content = io.BytesIO()
    FigureCanvasSVG(drawn()).print_svg(content)
    return content.getvalue().decode()


def test_places_are_kept_to_a_hundredth_and_characters_are_saved(svg):
    short = shortened(svg)
    places = [
        [
            float(x)
            for d in re.findall(r' d="([^"]*)"', of.replace(' d="M 0.98765"', ""))
            for x in re.findall(r"-?[\d.]+", d)
        ]
        for of in (svg, short)
    ]
    np.testing.assert_allclose(*places, atol=0.01)
    assert len(re.findall("<use ", short)) == len(re.findall("<use ", svg))
    assert len(re.sub(PICTURE, "", short)) < 0.6 * len(re.sub(PICTURE, "", svg))


def test_text_stays_text_as_it_was(svg):
    texts = [re.findall(r"<text[^>]*>([^<]*)</text>", of) for of in (svg, shortened(svg))]
    assert [html.unescape(text) for text in texts[1]] == [html.unescape(text) for text in texts[0]]
    assert any("0.123456 &lt;mm&gt;" in text for text in texts[1])
    assert any("d=&quot;M 0.98765&quot;" in text for text in texts[1])
    assert "'" not in shortened(svg)  # an address has quotes of one kind


def test_a_gradient_is_what_it_was_in_a_tenth_of_the_bytes(svg):
    was = re.findall(r"data:image/png;base64,\s*([^\"]+)", svg)
    now = re.findall(r"data:image/(?:webp|png);base64,\s*([^\"]+)", slim(drawn()))
    (large,) = [(a, b) for a, b in zip(was, now, strict=True) if len(a) > 3000]
    pictures = [
        np.asarray(Image.open(io.BytesIO(base64.b64decode(p))).convert("RGBA"), int) for p in large
    ]
    assert pictures[0].shape == pictures[1].shape
    assert np.abs(pictures[0] - pictures[1]).mean() < 2
    assert len(large[1]) < 0.2 * len(large[0])


def test_a_figure_is_written_as_matplotlib_writes_it_but_for_its_pictures(svg):
    written, own = (
        re.sub(PICTURE, "", re.sub(r"\s+", " ", text)) for text in (shortened(svg), slim(drawn()))
    )
    assert re.sub("Date.*?<", "<", own) == re.sub("Date.*?<", "<", written)


def test_words_that_look_like_a_picture_stay_words():
    made = drawn()
    made.axes[0].set_title("data:image/png;base64,AAAA")
    assert ">data:image/png;base64,AAAA<" in slim(made)
