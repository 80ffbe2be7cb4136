from . import field_truth as field_truth
from . import plate as plate
from .beam import Beams as Beams
from .beam import SceneObject as SceneObject
from .lab import VirtualLab as VirtualLab
from .scene import Scene as Scene
from .server import LabServer as LabServer
