"""3-D vibration velocity fields, with bounds, from one scanning laser Doppler vibrometer.

A run is composed of settings, as on the command line, and leaves one dataset:

>>> import sldvexp
>>> tree = sldvexp.run("experiment=point", "report=none")  # doctest: +SKIP
>>> tree = sldvexp.open_run("outputs/2026-11-28/10-00-00")  # doctest: +SKIP

`run` composes and does it in this process and raises `UserError` with one sentence where the
command would print one. `open_run` opens what a run left; ``help(sldvexp.run)`` says more.

On arrays, without a configuration, work the rooms of the house, in the order in which data flows;
each has a page of its own, as ``help(sldvexp.pose)``:

signal
    Samples of a vibrometer to complex amplitudes, with their noise.
image
    Circles in scans: edges, conics, matches; interpolation between pixels.
geometry
    Rotations, conics, bitangent points, cross-ratios.
laser
    The instrument's mirrors: DAC steps, angles, rays.
pose
    Where the instrument stood, from points and angles or from edges.
volume
    Surfaces around the vibrating one, on which a field is found.
reconstruction
    Velocity vectors at points, from line-of-sight velocities.
field
    The velocity field, from images, poses and a surface.
plot
    Figures of a run.
dataset
    What a run's groups hold: variables, dimensions, units.

Every name that these pages list has an example in its own help. ``sldvexp handbook`` in a shell
shows the conventions, a glossary and how to read a result.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
