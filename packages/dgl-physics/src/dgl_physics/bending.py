"""Bending constraints of a mesh, of a given flexural rigidity."""

import numpy as np

from dgl_physics import topology
from dgl_physics.stencils import StencilBlock


def make_bending(
    rest: np.ndarray,
    faces: np.ndarray,
    stiffness: float,
    *,
    factors: np.ndarray | None = None,
    damping_time: float = 0.0,
) -> StencilBlock:
    """Make the bending constraints of a mesh that is flat when nothing bends it.

    The constraint of a hinge is c = sum_j K_j x_j = 0. For linear positions in the plane of its two
    unfolded triangles c vanishes, and so sum_j K_j = 0: it pushes and turns nothing as a whole.
    Under a small curvature tensor k, c = Q : k along the normal, with Q = sum_j K_j y_j y_j^T / 2
    of the unfolded positions y_j. The energy of a hinge is s B |c|^2 / (2 (A0 + A1)), with the
    areas A0 and A1 of its triangles.

    The factor s of a mesh is such that bending to a cylinder of curvature k costs B k^2 / 2 per
    area, as the mean over all directions: with <n n n n> the isotropic tensor,
    s = sum (A0 + A1) / 3 / sum [((tr Q)^2 + 2 Q : Q) / 8 / (A0 + A1)]. It is 1 for equilateral
    triangles, for which the rigidity is the same in all directions. With the factor 3 of the paper,
    a bent strip of a mesh of equilateral triangles is three times too stiff.

    Args:
        rest: Rest positions [m], shape (V, 3).
        faces: Vertex indices, shape (F, 3).
        stiffness: Flexural rigidity B per width [N m].
        factors: Factor on it at each vertex, shape (V,); 1 everywhere when None. Seams between
            vertices that it stiffens bend as the sheet does: a band goes over them.
        damping_time: Relaxation time of the damping [s].

    Returns:
        Constraints between (edge 0, edge 1, wing 0, wing 1), with the weights K (no unit) and the
        compliance [m/N]. Seams that are folded at rest have none: they turn freely.

    Limitations:
        The sheet is taken as flat at rest also where `rest` is curved. Bending couples the two
        principal curvatures as Poisson's ratio -1/3 does (equilateral triangles): saddles cost more
        than in an isotropic plate.

    Source:
        Bergou, Wardetzky, Harmon, Zorin, Grinspun: A Quadratic Bending Model for Inextensible
        Surfaces, SGP 2006, section 3: the coefficients K.
    """
    hinges = topology.compute_hinges(faces)
    is_bent = topology.is_flat_hinge(rest, hinges)
    if factors is not None:
        is_bent |= factors[hinges[:, :2]].min(axis=1) > 1
    hinges = hinges[is_bent]
    if stiffness == 0 or len(hinges) == 0:
        return StencilBlock(
            vertices=np.zeros((0, 4), dtype=np.int32),
            weights=np.zeros((0, 4)),
            compliance=np.zeros(0),
            damping_time=damping_time,
        )
    unfolded = unfold_hinges(rest, hinges)
    length = unfolded[:, 1, 0]
    across = np.abs(unfolded[:, 2:, 1])  # (H, 2): heights of the wings
    share = unfolded[:, 2:, 0] / length[:, None]  # (H, 2): where their feet are along the edge
    slope = length[:, None] / across
    weights = np.column_stack(
        [-(slope * (1 - share)).sum(axis=1), -(slope * share).sum(axis=1), slope]
    )
    area = 0.5 * length * across.sum(axis=1)  # of both triangles
    q = 0.5 * np.einsum("hj,hja,hjb->hab", weights, unfolded, unfolded)
    trace = np.trace(q, axis1=1, axis2=2)
    mean_square = (trace**2 + 2 * (q**2).sum(axis=(1, 2))) / 8
    factor = (area / 3).sum() / (mean_square / area).sum()
    rigidity = stiffness * (1.0 if factors is None else factors[hinges[:, :2]].mean(axis=1))
    return StencilBlock(
        vertices=hinges,
        weights=weights,
        compliance=area / (factor * rigidity),
        damping_time=damping_time,
    )


def unfold_hinges(rest: np.ndarray, hinges: np.ndarray) -> np.ndarray:
    """Lay the two triangles of each hinge (H, 4) into a plane.

    Returns:
        Positions [m], shape (H, 4, 2): the edge from the origin along the first axis, the first
        wing to its left, the second to its right.
    """
    e0, e1, *wings = (rest[hinges[:, k]] for k in range(4))
    edge = e1 - e0
    length = np.linalg.norm(edge, axis=1)
    flat = np.zeros((len(hinges), 4, 2))
    flat[:, 1, 0] = length
    for k, (wing, side) in enumerate(zip(wings, (1.0, -1.0), strict=True)):
        along = np.sum((wing - e0) * edge, axis=1) / length
        height = np.linalg.norm(np.cross(edge, wing - e0), axis=1) / length
        flat[:, 2 + k] = np.column_stack([along, side * height])
    return flat
