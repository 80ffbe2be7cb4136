from . import image_file as image_file
from .base import ImageImporter as ImageImporter
from .base import Importer as Importer
from .base import PointImporter as PointImporter
from .pointwise import PointwiseImport as PointwiseImport
from .pointwise_data import PointwiseView as PointwiseView
