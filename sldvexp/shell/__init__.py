"""Smooth fields on the surface of a structure: motion along it, and strain, from the same images.

`estimate_surface` makes splines of the images of a run, for `reconstruction=shell` and ``spline``.
A `Chart` (`CylinderChart`, `HeightChart`) lays coordinates over the surface, `Outline` says how far
it goes, `ThinShell` holds the kinematics of Love, `WeightedFit` averages over how smooth the field
is.

A new method of this kind is a file with one dataclass that extends `SurfaceReconstruction` and is
registered under ``reconstruction``.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
