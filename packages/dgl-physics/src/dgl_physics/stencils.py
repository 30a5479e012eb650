"""Constraints between a few vertices each, coloured, on the host and on a device."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import warp as wp


@dataclass(frozen=True, kw_only=True)
class StencilBlock:
    """Constraints of one garment, of C times K vertices, K <= 4."""

    vertices: np.ndarray
    """Vertex indices, shape (C, K), int."""
    weights: np.ndarray
    """Four coefficients of each, shape (C, 4); what they mean is the constraint's."""
    compliance: np.ndarray
    """Inverse stiffness, shape (C,)."""
    damping_time: float
    """Relaxation time: damping over stiffness [s]; >= 0."""

    def colour(self, vertex_count: int) -> np.ndarray:
        """Colour the constraints, so that those of one colour share no vertex, shape (C,)."""
        return colour_stencils(self.vertices, vertex_count)


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


def colour_stencils(vertices: np.ndarray, vertex_count: int) -> np.ndarray:
    """Colour constraints so that those of one colour share no vertex.

    Greedy in the given order, so the result is deterministic.

    Args:
        vertices: Vertex indices, shape (C, K), int.
        vertex_count: Number of vertices.

    Returns:
        Colour of each constraint, shape (C,), int32, from 0.
    """
    used = [0] * vertex_count  # a bit per colour
    colours = np.empty(len(vertices), dtype=np.int32)
    for k, members in enumerate(vertices.tolist()):
        taken = 0
        for v in members:
            taken |= used[v]
        free = ~taken & (taken + 1)  # the lowest bit that is not taken
        for v in members:
            used[v] |= free
        colours[k] = free.bit_length() - 1
    return colours


def upload_stencils(
    blocks: Sequence[tuple[StencilBlock, np.ndarray, int]], device: str
) -> Stencils:
    """Join the constraints of garments and bring them onto a device.

    Args:
        blocks: Constraints of a garment, their colours, and the index of its first particle.
        device: Warp device.
    """
    colours = np.concatenate([np.zeros(0, np.int32), *(colour for _, colour, _ in blocks)])
    order = np.argsort(colours, kind="stable")
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
    starts = np.searchsorted(colours[order], np.arange(colours.max(initial=-1) + 2))
    return Stencils(
        vertices=wp.array(vertices[order], dtype=wp.vec4i, device=device),
        weights=wp.array(weights[order], dtype=wp.vec4, device=device),
        response=wp.array(response[order], dtype=wp.vec2, device=device),
        colour_start=tuple(int(s) for s in starts),
    )
