from . import writer as writer
from .functions import Function as Function
from .geometry import UniversalGeometry as UniversalGeometry
from .nodal import Nodal as Nodal
from .reader import UniversalFile as UniversalFile
from .reader import universal_file as universal_file
