from . import session as session
from .camera import Camera as Camera
from .camera import Operator as Operator
from .journal import Journal as Journal
