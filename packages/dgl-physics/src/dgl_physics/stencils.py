"""Constraints between a few vertices each, coloured, on the host and on a device."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import warp as wp

from dgl_physics.topology import sort_by_colour


@dataclass(frozen=True, kw_only=True)
class StencilBlock:
    """Constraints of one garment, of C times K vertices, K <= 4."""

    vertices: np.ndarray
    """Vertex indices, shape (C, K), int."""
    weights: np.ndarray
    """Four coefficients of each, shape (C, 4); their meaning depends on the constraint."""
    compliance: np.ndarray
    """Inverse stiffness, shape (C,)."""
    damping_time: float
    """Relaxation time: damping over stiffness [s]; >= 0."""


@dataclass(frozen=True)
class Stencils:
    """Constraints of all garments on one device, in the order of their colour."""

    vertices: wp.array
    """Particle indices, shape (C,), vec4i; the last is 0 where there are three."""
    weights: wp.array
    """Shape (C,), vec4."""
    response: wp.array
    """Compliance and relaxation time [s], shape (C,), vec2."""
    colour_start: tuple[int, ...]
    """First constraint of each colour, and the end of the last; (0,) when there are none."""

    @property
    def count(self) -> int:
        """Number of constraints."""
        return self.colour_start[-1]


def upload_stencils(
    blocks: Sequence[tuple[StencilBlock, np.ndarray, int]], device: str
) -> Stencils:
    """Join the constraints of garments on a device.

    A block holds a garment's constraints, their colours, and the index of its first particle.
    """
    colours = np.concatenate([np.zeros(0, np.int32), *(colour for _, colour, _ in blocks)])
    order, colour_start = sort_by_colour(colours)
    count = len(colours)
    vertices = np.zeros((count, 4), dtype=np.int32)
    weights = np.zeros((count, 4), dtype=np.float32)
    response = np.zeros((count, 2), dtype=np.float32)
    at = 0
    for block, colour, first in blocks:
        rows = slice(at, at + len(colour))
        vertices[rows, : block.vertices.shape[1]] = block.vertices + first
        weights[rows] = block.weights
        response[rows, 0] = block.compliance
        response[rows, 1] = block.damping_time
        at += len(colour)
    return Stencils(
        vertices=wp.array(vertices[order], dtype=wp.vec4i, device=device),
        weights=wp.array(weights[order], dtype=wp.vec4, device=device),
        response=wp.array(response[order], dtype=wp.vec2, device=device),
        colour_start=colour_start,
    )
