from . import plate_scene as plate_scene
from .beam import Beams as Beams
from .beam import SceneObject as SceneObject
from .lab import VirtualLab as VirtualLab
from .scene import Scene as Scene
from .server import LabServer as LabServer
