from .views import Examined as Examined
from .views import examine_views as examine_views
