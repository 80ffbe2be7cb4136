"""What images show: circles found in scan lines, and velocities between pixels.

Circles: `ScanLines` across an edge, on which a circle moves evenly (`even_motion`), give edge
points (`gradient_edges`, `pixel_edges`, `profile_edges`), these a conic in pinhole coordinates
(`fit_circle`). Conics of several circles are matched with the calibration object in
`sldvexp.image.matching`. Between pixels `Interpolation` weighs the neighbours of a place.

Another way to detect edges is a function of `edge_detection`; another interpolation a class with
the contract of `Interpolator`, named in `Interpolation`.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
