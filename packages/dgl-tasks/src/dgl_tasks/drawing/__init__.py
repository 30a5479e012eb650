"""SAPIEN's scenes, as the rasteriser draws them."""
