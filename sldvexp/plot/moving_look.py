"""Look of a surface in motion, which moving pictures and the page in the browser share."""

from __future__ import annotations

#: Grey that pale colours are mixed with, and its share.
PALE, PALENESS = 0.93, 0.75
#: Largest drawn deflection, as a share of the surface's diagonal, and duration of a period, s.
MOVING_SHARE, SECONDS_A_TURN = 0.08, 2.5
#: From where one looks at first, deg: about the z axis from x, and above the plane of x and y.
AZIMUTH, ELEVATION = -118.5, 30.0
