"""Warp kernels of the solver, the same for CPU and CUDA."""
