from .model import direction_cosines as direction_cosines
from .model import project as project
from .model import project_jacobian as project_jacobian
from .model import rays as rays
from .two_mirror import MIRRORS as MIRRORS
from .two_mirror import Board as Board
from .two_mirror import Mirror as Mirror
from .two_mirror import TwoMirror as TwoMirror
