"""Calibration objects: what stands in front of the instrument at positions known beforehand.

`Circles` (``target=circles``) are machined features on one or several planes, which a scan finds by
their edges; `FiducialPoints` (``target=points``) are marks that a person points at. Each gives
numbered `TargetPoints` with their standard deviations. A new object is a file here with a plugin
that extends `Target`, and a line in `sldvexp.config.registry`.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
