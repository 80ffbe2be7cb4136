"""Where the beam goes: plugins of the group `scan`.

A plugin extends `Scan` (its views and their parts); `ImageScan` is the base of those that make
velocity images. They know no instrument: the room `session` sends the beam.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
