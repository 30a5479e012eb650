"""Training data of the affordance model: garments in simulated states, and what cameras see of them."""

from dexgarmentlab.gam_data.garment import Made as Made
from dexgarmentlab.gam_data.generate import DataConfig as DataConfig
from dexgarmentlab.gam_data.generate import generate_data as generate_data
from dexgarmentlab.gam_data.generate import list_garments as list_garments
from dexgarmentlab.gam_data.sheet import draw_data_sheet as draw_data_sheet
