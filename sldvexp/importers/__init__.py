"""Importers: plugins of the group `instrument` that make datasets of files of other programs.

`sldvexp.importers.base` has their contract. `PointwiseImport` is the base of those whose files hold
points one by one and say little of their conventions: a new one reads its file into
`sldvexp.importers.pointwise_data.PointwiseData`, and directions, joining of views and pixels come
with it. A new importer is a file here and its line in `sldvexp.config.registry`.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
