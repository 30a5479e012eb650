"""Training data of the affordance model: simulated states and camera views."""

from dgl_collect.gam_data.garment import Made as Made
from dgl_collect.gam_data.generate import DataConfig as DataConfig
from dgl_collect.gam_data.generate import generate_data as generate_data
from dgl_collect.gam_data.generate import list_garments as list_garments
from dgl_collect.gam_data.views import see_surface as see_surface
