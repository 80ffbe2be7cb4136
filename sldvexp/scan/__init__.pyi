from .base import ImageScan as ImageScan
from .base import Sampling as Sampling
from .base import Scan as Scan
from .base import ScanPart as ScanPart
