from .base import Export as Export
from .base import VelocityExport as VelocityExport
from .base import export_all as export_all
from .velocities import velocities_of as velocities_of
