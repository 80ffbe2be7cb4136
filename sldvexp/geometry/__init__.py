"""Pure geometry, of arrays without units of their own or configuration.

Rotations and rigid motions (`rotation_from_euler`, `rigid_transform`); ellipses (`Ellipse`, the
module `conic`) and their fit to edge points (`fit_ellipse`); bitangents of ellipses (`bitangents`)
and of circles (the module `circles`); cross-ratios of four elements (the module `cross_ratio`);
boxes sorted into bins (`Bins`). All functions carry leading dimensions through.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
