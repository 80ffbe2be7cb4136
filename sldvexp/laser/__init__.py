"""The instrument as a projective camera: two offset mirrors, their boards and calibration.

`TwoMirror` is the plugin ``laser=two_mirror``: DAC steps to mirror angles and back. The functions
need no configuration: `project` gives the angles that point the beam at points of the laser frame,
`rays` the beam of each angle pair, `direction_cosines` the direction in which it measures. The
laser frame has z towards the scene and x along the up-down mirror's axis.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
