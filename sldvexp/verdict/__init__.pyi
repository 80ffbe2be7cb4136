from . import refinement as refinement
from .points import examine_points as examine_points
from .views import Examined as Examined
from .views import examine_views as examine_views
