"""A volume around the structure's surface: layers along its normals, and prisms between them.

Begin with `Grid` for a plate, `MeshFile` for a mesh of another program, or `PointSurface` for
points that were digitised on the structure. Each is a `Volume`: ``volume.prisms()`` are its nodes
and elements in the world, ``volume.rule()`` says where velocities are sampled in every prism
(`SampleSettings`), and ``volume.sight`` how views see the samples (`VisibilitySettings`).
`sample_positions` and `shape_matrix` lead from nodal values to samples.

A new kind of surface is a file with one dataclass that extends `Volume`, has the one hook
`surface`, which returns a `TriangulatedSurface` in its own axes, and is registered. Surfaces and
prisms that are unsound are refused, with a sentence that names the node.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
