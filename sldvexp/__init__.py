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

The joints between them, from marks and images as arrays to a field and its figure:

>>> import numpy as np
>>> from sldvexp import field, laser, plot, pose, reconstruction, volume
>>> mirrors, down = laser.TwoMirror(), np.diag([1.0, -1.0, -1.0])
>>> rng = np.random.default_rng(1)
>>> marks = np.array([[x, y, z] for x in (-0.2, 0.2) for y in (-0.2, 0.2) for z in (0.0, 0.1)])
>>> step = np.radians(np.linspace(-24, 24, 25))
>>> angle = np.stack(np.meshgrid(step, step), axis=-1).reshape(-1, 2)  # of the pixels
>>> def view_from(name, x, y):  # a pose from eight marks, and an image of a plate that moves
...     dac = np.rint(mirrors.dac_from_angle(laser.project((marks - [x, y, 1.5]) @ down)))
...     at = pose.solve_points(marks, mirrors.angle_from_dac(dac), step=mirrors.step)
...     seen = laser.direction_cosines(angle) @ down @ [0, 1e-3, 2e-3 + 1e-3j]
...     seen = seen + 1e-6 * rng.standard_normal(len(seen))
...     poses = {"covariance": at.covariance, "angle": angle, "laser": mirrors}
...     return field.View.from_arrays(name, at.rotation, at.origin, seen, 1e-6, **poses)
>>> views = [view_from("left", -0.4, -0.3), view_from("right", 0.4, -0.3), view_from("top", 0, 0.4)]
>>> plate = volume.Grid(size=[0.2, 0.2], shape=[3, 3], layers=2)
>>> found = field.estimate_field(views, mirrors, plate, reconstruction.Absolute())
>>> abs(1e3 * found.velocity[0, :, 0]).round(1).tolist()
[0.0, 1.0, 2.2]
>>> figure = plot.field(found)  # plot.save(figure, "field") writes it

Every name that these pages list has an example in its own help. ``sldvexp handbook`` in a shell
shows the conventions, a glossary and how to read a result.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
