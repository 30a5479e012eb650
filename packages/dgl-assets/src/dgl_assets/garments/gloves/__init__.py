"""Five-fingered gloves as elastic shells.

A glove lies with the back of the hand uppermost, the opening towards +y and the fingers towards -y,
seams at z = 0, centred in x and y by the bounding box. The thumb of a right glove points to +x.
"""

from dgl_assets.garments.gloves.glove import make_glove as make_glove
from dgl_assets.garments.gloves.parameters import GloveParameters as GloveParameters
from dgl_assets.garments.gloves.sampling import sample_glove as sample_glove
