"""Figures of a page look the same in fewer characters."""

from __future__ import annotations

import base64
import html
import io
import re

import numpy as np
import pytest
from matplotlib.backends.backend_svg import FigureCanvasSVG
from PIL import Image

from sldvexp.plot import style
from sldvexp.report.html.slim import slim


@style.styled
def drawn():
    """A figure with curves, markers, words and a picture of a gradient."""
    made = style.figure(3)
    axes = made.subplots(1, 2)
    axes[0].plot(np.linspace(0, 1, 200), np.linspace(0, 1, 200) ** 2, marker="o")
    axes[0].set_title('of 0.123456 <mm> & d="M 0.98765"')
    axes[1].imshow(np.outer(*2 * [np.sin(np.linspace(0, 3, 300))]), interpolation="bilinear")
    return made


@pytest.fixture(scope="module")
def svg():
    content = io.BytesIO()
    FigureCanvasSVG(drawn()).print_svg(content)
    return content.getvalue().decode()


def test_places_are_kept_to_a_hundredth_and_characters_are_saved(svg):
    short = slim(svg)
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
    assert len(short) < 0.5 * len(svg)


def test_text_stays_text_as_it_was(svg):
    texts = [re.findall(r"<text[^>]*>([^<]*)</text>", of) for of in (svg, slim(svg))]
    assert [html.unescape(text) for text in texts[1]] == [html.unescape(text) for text in texts[0]]
    assert any("0.123456 &lt;mm&gt;" in text for text in texts[1])
    assert any("d=&quot;M 0.98765&quot;" in text for text in texts[1])
    assert "'" not in slim(svg)  # an address has quotes of one kind


def test_a_gradient_is_what_it_was_in_a_tenth_of_the_bytes(svg):
    (kind, was), *_ = re.findall(r"data:image/(png);base64,\s*([^\"]+)", svg)
    (other, now), *_ = re.findall(r"data:image/(webp);base64,\s*([^\"]+)", slim(svg))
    assert (kind, other) == ("png", "webp")
    pictures = [
        np.asarray(Image.open(io.BytesIO(base64.b64decode(p))).convert("RGBA"), int)
        for p in (was, now)
    ]
    assert pictures[0].shape == pictures[1].shape
    assert np.abs(pictures[0] - pictures[1]).mean() < 2
    assert len(now) < 0.2 * len(was)
