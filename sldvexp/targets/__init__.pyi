from .base import Target as Target
from .base import TargetPoints as TargetPoints
from .base import std_of_bound as std_of_bound
from .circles import Circle as Circle
from .circles import Circles as Circles
from .circles import Plane as Plane
from .points import FiducialPoint as FiducialPoint
from .points import FiducialPoints as FiducialPoints
