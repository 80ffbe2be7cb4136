from .files import read as read
from .files import write as write
from .netcdf import from_dataset as from_dataset
from .netcdf import to_dataset as to_dataset
from .table import RegistrationTable as RegistrationTable
