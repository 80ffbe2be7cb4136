from .files import read as read
from .table import FileLayout as FileLayout
from .table import LineOfSight as LineOfSight
