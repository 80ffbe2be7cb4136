"""Line-of-sight velocities of points with their directions: one checked table, several formats.

`read` reads a file by its ending into a `LineOfSight`; a `FileLayout` says how others name and
order what is in it. A new format is a function and its ending in
`sldvexp.io.velocities.files.READERS`.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
