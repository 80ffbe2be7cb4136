from .base import Check as Check
from .base import Examination as Examination
from .expectations import evaluate as evaluate
from .expectations import lookup as lookup
