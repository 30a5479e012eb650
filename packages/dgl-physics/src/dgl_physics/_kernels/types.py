# type: ignore  # kernels are in the language of Warp
"""Structs that the kernels share."""

import warp as wp


@wp.struct
class ParticleMaterial:
    """Parameters of one garment; see `dgl_physics.ContactMaterial`."""

    friction: wp.float32
    adhesion: wp.float32
    adhesion_radius: wp.float32
    rest_offset: wp.float32
    drag: wp.float32
    stiffening: wp.float32
    """Force of compressed cloth over its depth and mass [1/s^2]."""
    stretch_damping: wp.float32
    is_solid: wp.int32
    """1 if rigid contact is resolved with elasticity, in `_kernels.solid_contact`."""


@wp.struct
class SolverLimits:
    """Settings of the solver; see `dgl_physics.SolverConfig`."""

    max_speed: wp.float32
    separation_speed: wp.float32
    neighbour_margin: wp.float32
    cell_size: wp.float32
    """Twice the distance within which particles are listed as neighbours [m]."""
    neighbour_capacity: wp.int32
    near_capacity: wp.int32
    sleep_frames: wp.int32
    """Still frames after which cloth sleeps."""
    sleep_distance: wp.float32
    """Root mean square distance of still particles from their anchors, at most [m]."""


@wp.struct
class Grid:
    """Signed distances of one mesh; see `dgl_physics.distance_grid`."""

    lower: wp.vec3
    spacing: wp.float32
    blocks: wp.vec3i
    reach: wp.float32
    first_fine: wp.array(dtype=wp.int32)
    value: wp.array(dtype=wp.float32)


@wp.struct
class ShapeTable:
    """Rigid shapes of one environment; the same in all environments."""

    kind: wp.array(dtype=wp.int32)
    size: wp.array(dtype=wp.vec3)
    pose: wp.array(dtype=wp.transform)
    body: wp.array(dtype=wp.int32)
    friction: wp.array(dtype=wp.float32)
    radius: wp.array(dtype=wp.float32)
    is_moving: wp.array(dtype=wp.int32)
    is_measured: wp.array(dtype=wp.int32)
    grid: wp.array(dtype=wp.int32)
    grids: wp.array(dtype=Grid)
