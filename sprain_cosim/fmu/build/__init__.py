"""FMUs built from the folders of fmus/ and from the projects of `brace new`."""

from .description import BASE_UNITS as BASE_UNITS
from .link import headers as headers
from .models import CONSTANTS as CONSTANTS
from .models import build_all as build_all
from .models import build_fmu as build_fmu
from .models import constants_file as constants_file
from .models import own_platform as own_platform
from .packing import EPOCH as EPOCH
from .packing import pack as pack
