"""Axes whose ticks are drawn together, in a fraction of the time and looking the same.

matplotlib makes five artists for every tick: two marks, a line of the grid and two numbers. Here
one tick stands for all of a figure that look like it: its line of the grid goes through every place
of an axis, its marks are drawn at every place, and its numbers are written one after the other. An
axis whose single ticks somebody asked for has and draws those.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from copy import copy
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis, XAxis, YAxis
from matplotlib.font_manager import FontProperties
from matplotlib.ticker import FixedFormatter, FixedLocator, MaxNLocator, NullLocator

from sldvexp.plot.paper import POINTS, long
from sldvexp.typing import Array, BoolArray

#: Attributes with an axis' single ticks, which are made when they are first asked for.
SINGLE = ("majorTicks", "minorTicks")
#: Without types: those of matplotlib leave out what an axis is made of.
_Axis: Any = Axis
#: Share of an axis' length by which a tick may be beyond its ends.
BESIDE = 1e-10


class _SharedTickAxis(_Axis):
    """An axis that draws its ticks together.

    Attributes
    ----------
    reach : tuple of float
        How far ticks and their numbers reached at last, pixels: at the left or below, and at the
        right or above.
    """

    #: Which coordinate of the figure goes across the axis.
    across = 0
    #: Whether the first number begins at its tick and the last one ends there, as where another
    #: axis goes on; otherwise, and between them, a number's middle is at its tick.
    begins = ends = False
    reach = (0.0, 0.0)

    def set_tick_params(self, *args: Any, **kwargs: Any) -> None:
        with self._without_single_ticks():
            super().set_tick_params(*args, **kwargs)

    def set_clip_path(self, *args: Any, **kwargs: Any) -> None:
        if self._has_single_ticks:  # all others are clipped as they are made, or drawn
            super().set_clip_path(*args, **kwargs)

    @contextmanager
    def _without_single_ticks(self) -> Iterator[None]:
        """Keep what changes all ticks from making the first of them."""
        own: dict[str, Any] = self.__dict__
        lacking = [name for name in SINGLE if name not in own]
        own.update({name: [] for name in lacking})
        try:
            yield
        finally:
            for name in lacking:
                own.pop(name, None)

    def _get_tick(self, major: bool) -> Any:
        tick = super()._get_tick(major)
        tick.set_clip_path(self.axes.patch)
        return tick

    @property
    def _has_single_ticks(self) -> bool:
        return any(vars(self).get(name) for name in SINGLE)

    def draw(self, renderer: Any) -> None:
        """Draw grid, marks, numbers and the axis' name."""
        if self._has_single_ticks:
            super().draw(renderer)
        if self._has_single_ticks or not self.get_visible():
            return
        renderer.open_group(__name__, gid=self.get_gid())
        box = self.axes.bbox
        self.reach = box.min[self.across], box.max[self.across]
        for major in (True, False):
            self._draw_ticks(renderer, major)
        if self.label.get_text():
            self._update_label_position(renderer)
            self.label.draw(renderer)
        self.offsetText.set_text(self.major.formatter.get_offset())
        if self.offsetText.get_text():
            self._update_offset_text_position([], [])
            self.offsetText.draw(renderer)
        renderer.close_group(__name__)
        self.stale = False

    def _draw_ticks(self, renderer: Any, major: bool) -> None:
        """Draw ticks of one kind, with their numbers."""
        kind = self.major if major else self.minor
        look = self._major_tick_kw if major else self._minor_tick_kw
        if isinstance(kind.locator, NullLocator) or not self._tick_group_visible(look):
            return
        every = np.asarray(self.get_majorticklocs() if major else self.get_minorticklocs(), float)
        texts = kind.formatter.format_ticks(every)
        seen = self._in_view(every)
        places, count = every[seen], int(seen.sum())
        if not count:
            return
        tick = self._tick(look, major)
        self._go(tick.gridline, np.repeat(places, 3), np.tile([0.0, 1.0, np.nan], count))
        self._go(tick.tick1line, places, np.zeros(count))
        self._go(tick.tick2line, places, np.ones(count))
        numbers = [text for text, own in zip(texts, seen, strict=True) if own]
        for line in (tick.gridline, tick.tick1line, tick.tick2line):
            line.draw(renderer)
        out = tick.get_tick_padding() * self.get_figure(root=True).dpi / POINTS
        low, high = self.reach
        low -= out * tick.tick1line.get_visible()
        high += out * tick.tick2line.get_visible()
        for label in (tick.label1, tick.label2):
            if not label.get_visible():
                continue
            for k, (place, number) in enumerate(zip(places, numbers, strict=True)):
                label.set_text(number)
                self._put(label, place, self.begins and k == 0, self.ends and k == count - 1)
                if self.label.get_text():
                    box = label.get_window_extent(renderer)
                    low = min(low, box.min[self.across])
                    high = max(high, box.max[self.across])
                label.draw(renderer)
        self.reach = low, high

    def _tick(self, look: dict[str, Any], major: bool) -> Any:
        """Take the figure's tick of this look to these axes."""
        known = vars(self.get_figure(root=False)).setdefault("ticks_of_panels", {})
        name = type(self), major, tuple(sorted(look.items()))
        if name not in known:
            known[name] = self._get_tick(major=major)
        tick, axes = known[name], self.axes
        tick.axes = None  # it leaves those that it was drawn in before
        tick.axes = axes
        tick.gridline.set_clip_box(axes.bbox)
        transform = getattr(axes, f"get_{self.axis_name}axis_transform")
        tick.gridline.set_transform(transform("grid"))
        tick.tick1line.set_transform(transform("tick1"))
        tick.tick2line.set_transform(transform("tick2"))
        tick.label1.set_transform(tick._get_text1_transform()[0])
        tick.label2.set_transform(tick._get_text2_transform()[0])
        return tick

    def _in_view(self, places: Array) -> BoolArray:
        """Find the places between the ends of the axis, and at them."""
        change = self.get_transform().transform
        low, high = np.sort(change(np.array(self.get_view_interval(), float)))
        at, beside = change(places), BESIDE * (high - low)
        found: BoolArray = (at >= low - beside) & (at <= high + beside)
        return found

    def _update_label_position(self, renderer: Any) -> None:
        """Put the axis' name beside what the ticks reached."""
        if self._has_single_ticks:
            super()._update_label_position(renderer)
        elif self._autolabelpos:
            place = list(self.label.get_position())
            away = self.labelpad * self.get_figure(root=True).dpi / POINTS
            below = self.label_position in ("bottom", "left")
            place[self.across] = self.reach[0] - away if below else self.reach[1] + away
            self.label.set_position(place)

    def _go(self, line: Any, along: Array, across: Array) -> None:
        """Lead a line through places, which stand along the axis."""
        raise NotImplementedError

    def _put(self, label: Any, place: float, begins: bool, ends: bool) -> None:
        """Put a number beside a place."""
        raise NotImplementedError


class _SharedTickX(_SharedTickAxis, XAxis):
    across = 1

    def get_majorticklocs(self) -> Array:
        """Find the places of ticks, as many as have numbers that do not run together."""
        every: Array = np.asarray(super().get_majorticklocs(), float)
        if not isinstance(self.major.locator, MaxNLocator):
            return every
        fewer = copy(self.major.locator)
        for most in range(int(self._in_view(every).sum()) - 1, 0, -1):
            if self._are_apart(every):
                break
            fewer.set_params(nbins=most, min_n_ticks=1)
            every = np.asarray(fewer.tick_values(*np.sort(self.get_view_interval())), float)
        return every

    def _are_apart(self, places: Array) -> bool:
        """Tell whether two letters fit between the numbers of neighbouring ticks.

        One of them is what letters of whole dots on a screen may be wider than in print.
        """
        places = places[self._in_view(places)]
        if len(places) < 2:
            return True
        size = FontProperties(size=matplotlib.rcParams["xtick.labelsize"]).get_size_in_points()
        formatter: Any = self.major.formatter
        wide = [long(text, size) for text in formatter.format_ticks(places)]
        at = self.axes.transData.transform(np.column_stack([places, 0 * places]))[:, 0]
        figure: Any = self.get_figure(root=True)
        between = np.abs(np.diff(at)) / figure.dpi
        needed = np.convolve(wide, [0.5, 0.5], "valid") + long("00", size)
        return bool((between >= needed).all())

    def _go(self, line: Any, along: Array, across: Array) -> None:
        line.set_data(along, across)

    def _update_ticks(self) -> Any:
        """Bring single ticks up to date, see `begins`."""
        seen = super()._update_ticks()
        for tick in seen[:1] if self.begins else ():
            tick.label1.set_horizontalalignment("left")
        for tick in seen[-1:] if self.ends else ():
            tick.label1.set_horizontalalignment("right")
        return seen

    def _put(self, label: Any, place: float, begins: bool, ends: bool) -> None:
        label.set_x(place)
        label.set_horizontalalignment("left" if begins else "right" if ends else "center")


class _SharedTickY(_SharedTickAxis, YAxis):
    across = 0

    def _go(self, line: Any, along: Array, across: Array) -> None:
        line.set_data(across, along)

    def _put(self, label: Any, place: float, begins: bool, ends: bool) -> None:
        label.set_y(place)


def set_numbers(axis: Any, places: Any, names: Sequence[str] | None = None) -> None:
    """Set the places of an axis' ticks, and what is written there in the place of numbers.

    ``Axis.set_ticks`` would ask for single ones.
    """
    axis.set_major_locator(FixedLocator(places))
    if names is not None:
        axis.set_major_formatter(FixedFormatter(names))


class SharedTickAxes(Axes):
    """Axes that draw the ticks of an axis together.

    Examples
    --------
    >>> from matplotlib.figure import Figure
    >>> panel = Figure().add_subplot(axes_class=SharedTickAxes)
    >>> [number.get_text() for number in panel.get_xticklabels()]
    ['0.0', '0.2', '0.4', '0.6', '0.8', '1.0']
    """

    def clear(self) -> None:
        """Clear the axes."""
        super().clear()
        for spine in self.spines.values():
            spine.get_spine_transform()  # with which it is put in its place, ticks or none

    def _init_axis(self) -> None:
        self.xaxis, self.yaxis = _SharedTickX(self, clear=False), _SharedTickY(self, clear=False)
        for axis, sides in ((self.xaxis, ("bottom", "top")), (self.yaxis, ("left", "right"))):
            for side in sides:
                self.spines[side].register_axis(axis)
