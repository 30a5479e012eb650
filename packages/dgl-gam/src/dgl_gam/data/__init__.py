"""Training data: a file for each garment, folders of files, and batches of views."""

from dgl_gam.data.folder import GarmentFolder as GarmentFolder
from dgl_gam.data.garment_file import FORMAT_VERSION as FORMAT_VERSION
from dgl_gam.data.garment_file import GarmentData as GarmentData
from dgl_gam.data.garment_file import GarmentHeader as GarmentHeader
from dgl_gam.data.garment_file import read_garment as read_garment
from dgl_gam.data.garment_file import read_header as read_header
from dgl_gam.data.garment_file import write_garment as write_garment

__all__ = [
    "FORMAT_VERSION",
    "GarmentData",
    "GarmentFolder",
    "GarmentHeader",
    "read_garment",
    "read_header",
    "write_garment",
]
