"""From a vibrometer's samples to complex pixels: the dissertation's Section 3.2.

`SineFit` is what a configuration chooses (``signal=sine_fit``): the sines of known frequencies are
fitted to both channels of every pixel by least squares, and the quotient of their phasors is the
velocity with its phase relative to the reference. `demodulate` is the same on arrays, with the
model of the records that `sine_model` makes. `Flag` says why a pixel is not to be trusted.

Another estimator is a dataclass that extends `SignalEstimator`, in a file of its own here.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
