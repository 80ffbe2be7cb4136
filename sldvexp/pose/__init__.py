"""Where the instrument stood: poses of its laser frame, with bounds.

With arrays, without a configuration: `solve_points` finds a pose from object points and the mirror
angles that reach them, without a starting guess; `solve_points_together` those of several views
whose mirrors share intrinsics; `solve_edges` those of all views of a calibration object from the
edges of its circles (`EdgePoints`). Each result says in its ``repr`` where the instrument stood and
how well the data fits, and makes the group ``pose`` of a run with ``to_dataset``.

In a run a strategy does the same with the run's data: ``pose=bitangent``, ``edge``, ``digitizer``,
``manual``, ``registration`` or ``given``, each a file here. A new one extends `PoseMethod`, which
holds the contract, returns a `PoseResult`, and stands in a line of `sldvexp.config.registry`;
`FromPoints` and `FromScans` give it the solution of matched points and of scanned circles.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
