"""Warp kernels of the rasteriser."""
