"""The virtual lab: physics in place of an instrument. Nothing that processes data imports it.

`VirtualLab` puts an instrument in front of a `Scene` and answers as hardware would; `LabServer`
serves it over TCP. A scene is a plugin of the group `scene` and lists its `SceneObject`s, of which
each says where beams hit it and how it moves there.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
