"""The velocity vector at a point, from line-of-sight velocities (Chapter 5.2).

Every method applies rows A, views or differences of views, to both sides of ``v = D V``: `Absolute`
takes the views themselves, `Relative` differences of them, `Combined` any mixture, `Contravariant`
three rows whose reciprocal basis carries the velocity. Begin with
``Absolute().reconstruct(directions, velocity, std)``, which returns a `PointVelocity` for any
number of points and frequencies.

Directions point from the surface to the instrument, velocities are positive towards it, bounds hold
for real and imaginary part each. Where the views do not determine a component it is NaN and has a
flag.

A new method is a file with one dataclass that extends `Reconstruction`, has the one hook
`row_choice` and is registered; `rows` has what such a hook is made of. Inside: `views` checks the
data, `system` joins them with rows and settings, `least_squares` has the estimators of a stack of
points, `solve` applies them block by block, `observability` tells what is not determined.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
