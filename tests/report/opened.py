"""A page in the browser, and what tests look at in it."""

from __future__ import annotations

import numpy as np

PHONE, DESKTOP = (390, 844), (1280, 900)


class Opened:
    """A page in the browser, at a size."""

    def __init__(self, driver, path, size):
        self.driver, self.js, self.wait, self.path = driver, driver.js, driver.wait, path
        driver.size(*size)
        driver.open(path)
        self.wait(lambda: self.js("return document.getElementById('shape-plot').dataset.ready"))

    def set(self, name, value):
        self.js(
            "const e = document.getElementById('shape-' + arguments[0]); e.value = arguments[1];"
            "e.dispatchEvent(new Event('input'))",
            name,
            value,
        )

    def drawn(self, offset=0):
        """Place and value of every node, as the graphics processor has worked them out."""
        code = "return Array.from(document.getElementById('shape-plot').shape.drawn(arguments[0]))"
        return np.array(self.js(code, offset), float).reshape(-1, 4)

    @property
    def deflection(self):
        return self.drawn()[:, 2]

    @property
    def colours(self):
        return self.drawn()[:, 3]

    def joined(self, name):
        """Tell which nodes are drawn as what."""
        code = "return Array.from(document.getElementById('shape-plot').shape.joined(arguments[0]))"
        return self.js(code, name)

    def focus(self, name):
        self.js("document.getElementById('shape-' + arguments[0]).focus()", name)

    def box(self, name):
        """Left, top, width and height of a part that is brought into view."""
        return self.js(
            "const e = document.getElementById('shape-' + arguments[0]);"
            "e.scrollIntoView({block: 'center'}); const b = e.getBoundingClientRect();"
            "return [b.left, b.top, b.width, b.height]",
            name,
        )

    def click(self, name, across=0.5, down=0.5):
        left, top, width, height = self.box(name)
        at = (left + across * width, top + down * height)
        self.driver.mouse(at, at)

    def told(self, name, attribute):
        code = "return document.getElementById('shape-' + arguments[0]).getAttribute(arguments[1])"
        return self.js(code, name, attribute)

    def text(self, name):
        return self.js("return document.getElementById('shape-' + arguments[0]).textContent", name)


def place_of(shown, node):
    """Find where a node is seen in the window."""
    left, top, *_ = shown.box("stage")
    x, y, _ = shown.js(
        "return document.getElementById('shape-plot').shape.seen(arguments[0])", node
    )
    return left + x, top + y


def nothing_is_wider_than_the_window(shown):
    assert shown.js("return document.documentElement.scrollWidth - innerWidth") <= 0
    wide = shown.js(
        "return [...document.querySelectorAll('main *')].filter(e => !e.closest('.scroll, details,"
        " #shape-plot') && e.getBoundingClientRect().right > innerWidth + 1).map(e => e.outerHTML)"
    )
    assert wide == []
