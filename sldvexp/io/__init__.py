"""Formats of files, which know no configuration and no plugin: paths in, arrays in SI units out.

Tables of text with units in the header have one reader, `read_table`; `read_points` reads digitised
points with it, `read_gages` strains. `read_mesh` reads surfaces, `read_centres`, `read_list` and
`read_rectangle` legacy files of scans, `vtu` and `pvd` are the texts that ParaView opens, and `glb`
is a moving surface for browsers. Formats of several files have rooms of their own:
`sldvexp.io.registration`, `sldvexp.io.velocities` and `sldvexp.io.uff`. A new format is a module
here; what is wrong with a file is one sentence that names the file and the line.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
