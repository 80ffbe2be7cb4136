"""`scan=calibration`: lines across the circles of a calibration object, coarse and then fine."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum

from sldvexp.errors import Checks
from sldvexp.registry import register

#: Steps of the smaller range of a mirror's board: no line has more pixels.
MOST_PIXELS = 8193


class EdgeMethod(Enum):
    """How an edge is placed between pixels."""

    gradient = "gradient"
    profile = "profile"


@dataclass
class Sampling:
    """How each pixel is sampled.

    Parameters
    ----------
    rate : float, Hz
    samples : int
    frequency : list of float, Hz
        Of the excitation.
    amplitude : float, V
        Peak of each frequency.
    """

    rate: float = 25600.0
    samples: int = 512
    frequency: list[float] = field(default_factory=lambda: [450.0])
    amplitude: float = 1.0

    def check(self, checks: Checks, name: str) -> None:
        """Note under `name` what is wrong."""
        checks.positive(f"{name}.rate", self.rate)
        checks.positive(f"{name}.amplitude", self.amplitude)
        enough = f"must be at least 16, not {self.samples}"
        checks.require(self.samples >= 16, f"{name}.samples", enough)
        checks.require(bool(self.frequency), f"{name}.frequency", "needs at least one frequency")
        for hertz in self.frequency:
            checks.positive(f"{name}.frequency", hertz)
            too_high = f"{hertz:g} Hz needs a rate above {2 * hertz:g} Hz"
            checks.require(2 * hertz < self.rate, f"{name}.frequency", too_high)


@dataclass
class Lines:
    """Scan lines of one stage: how many a circle, how long, and the median filter's window."""

    lines: int
    pixels: int
    window: int

    def check(self, checks: Checks, name: str) -> None:
        """Note under `name` what is wrong."""
        checks.require(self.lines >= 3, f"{name}.lines", f"must be at least 3, not {self.lines}")
        least = f"must be at least 9, not {self.pixels}"
        checks.require(self.pixels >= 9, f"{name}.pixels", least)
        most = f"must be at most the {MOST_PIXELS} steps of a mirror, not {self.pixels}"
        checks.require(self.pixels <= MOST_PIXELS, f"{name}.pixels", most)
        odd = f"must be odd and shorter than the line, not {self.window}"
        good = self.window % 2 == 1 and 0 < self.window < self.pixels
        checks.require(good, f"{name}.window", odd)


@dataclass
class Centres:
    """Rough centres of a view's circles, in any order, in DAC steps (up_down, left_right).

    Parameters
    ----------
    dac : list of pairs
    path : str
        A legacy file of them (`Scan6pt`), instead.
    """

    dac: list[list[int]] = field(default_factory=list)
    path: str = ""


@register("scan", "calibration")
@dataclass
class Calibration:
    """The dissertation's coarse and fine lines across each circle (Section 4.5.2).

    Parameters
    ----------
    views : dict of str to Centres
        Rough centres of the circles in each view.
    coarse : Lines
        Across the whole circle, through its rough centre.
    fine : Lines
        Across the edge, around the coarse ellipse.
    edge : EdgeMethod
        For the fine lines.
    sampling : Sampling
    """

    views: dict[str, Centres] = field(default_factory=dict)
    coarse: Lines = field(default_factory=lambda: Lines(3, 300, 25))
    fine: Lines = field(default_factory=lambda: Lines(44, 25, 5))
    edge: EdgeMethod = EdgeMethod.profile
    sampling: Sampling = field(default_factory=Sampling)

    def __post_init__(self) -> None:
        checks = Checks()
        checks.require(bool(self.views), "views", "needs at least one view with rough centres")
        for name, centres in self.views.items():
            # A view's lines are kept in a folder of its name.
            usable = name.strip() not in ("", ".", "..") and not set(name) & {"/", "\\"}
            told = f"the view {name!r} needs a name that a folder can have, without / and \\"
            checks.require(usable, "views", told)
            one = bool(centres.dac) != bool(centres.path)
            checks.require(one, f"views.{name}", "give either dac or path, not both or none")
            pairs = all(len(pair) == 2 for pair in centres.dac)
            checks.require(pairs, f"views.{name}.dac", "must be pairs [up_down, left_right]")
        self.coarse.check(checks, "coarse")
        self.fine.check(checks, "fine")
        self.sampling.check(checks, "sampling")
        checks.done()

    def inputs(self) -> list[str]:
        """Files of rough centres."""
        return [c.path for c in self.views.values() if c.path]

    def pixels(self, circles: int) -> int:
        """How many pixels a view with so many circles takes."""
        stages = (self.coarse, self.fine)
        return circles * sum(stage.lines * stage.pixels for stage in stages)
