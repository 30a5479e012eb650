"""Stretch and shear of a mesh, of given moduli: a net of springs, and yarns along warp and weft.

A net of springs of stiffness k_e = a A_e / l_e^2 along the edges of a mesh, with the length l_e of
the edge and a third of the area of its triangles A_e, has the energy a <(n.E n)^2> / 2 per area
under the strain E, whatever the size of the triangles; n are the directions of the edges, the mean
is weighted with A_e. In an even mesh of triangles n is spread evenly, as <n n n n> is isotropic for
equilateral triangles, and C_11 = 3a/8, C_12 = C_66 = a/8: the shear modulus is G = a/8, Young's
modulus a/3. C_12 = C_66 is Cauchy's relation, which every net of central forces follows, so
Poisson's ratio is not free: it is 1/3.

No choice of k_e by direction makes such a mesh soft in shear: with three directions of edges G is
at least a third of the larger tensile modulus; in fabrics it is a tenth to a hundredth. So the net
carries the shear modulus alone, and yarns carry the rest of the tensile modulus. They lie in every
triangle along the axes of the flat rest, and add k to C_11 and C_22 and nothing to C_12 and C_66.
Then E = C_11 - C_12^2 / C_11, C_12 = C_66 = G and C_11 = 3 G + k.
"""

from dataclasses import dataclass

import numpy as np

from dgl_physics import topology
from dgl_physics.stencils import StencilBlock

ISOTROPIC_SHEAR = 3 / 8
"""Shear modulus of a net without yarns, over its Young's modulus."""


@dataclass(frozen=True, kw_only=True)
class MembraneModuli:
    """Moduli of net and yarns [N/m]."""

    net: float
    """The factor a of the springs' stiffness."""
    yarn: float
    """Stiffness of the yarns per width, of each direction; 0 for none."""


def compute_moduli(stretch: float, shear: float | None) -> MembraneModuli:
    """Divide tensile and shear modulus between net and yarns.

    Args:
        stretch: Young's modulus of the membrane along warp and weft [N/m].
        shear: Shear modulus [N/m], at most 3/8 of `stretch`; None for 3/8: isotropic, no yarns.
    """
    if shear is None or shear == ISOTROPIC_SHEAR * stretch:
        return MembraneModuli(net=3 * stretch, yarn=0.0)
    along = 0.5 * (stretch + np.sqrt(stretch**2 + 4 * shear**2))
    return MembraneModuli(net=8 * shear, yarn=float(along - 3 * shear))


def compute_tensile_modulus(moduli: MembraneModuli, angle: np.ndarray) -> np.ndarray:
    """Compute Young's modulus along directions between weft and warp.

    Args:
        moduli: Of net and yarns.
        angle: Between the direction and the weft [rad].

    Returns:
        [N/m], of the shape of `angle`.
    """
    shear = moduli.net / 8
    along = 3 * shear + moduli.yarn
    s11, s12 = np.linalg.inv([[along, shear], [shear, along]])[0]
    c, s = np.cos(angle) ** 2, np.sin(angle) ** 2
    return 1.0 / (s11 * (c**2 + s**2) + (2 * s12 + 1 / shear) * c * s)


def compute_edge_stiffness(
    rest: np.ndarray, faces: np.ndarray, edges: np.ndarray, net: float
) -> np.ndarray:
    """Compute the stiffness of the springs along sorted edges (E, 2) [N/m], shape (E,).

    `rest` are positions [m], shape (V, 3); `net` is the factor a of `MembraneModuli` [N/m].
    """
    a, b, c = (rest[faces[:, k]] for k in range(3))
    third = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 6
    sides = np.sort(topology.list_sides(faces), axis=1)
    base = len(rest)
    at = np.searchsorted(edges[:, 0].astype(np.int64) * base + edges[:, 1], sides @ [base, 1])
    area = np.bincount(at, weights=np.tile(third, 3), minlength=len(edges))
    square = np.sum((rest[edges[:, 0]] - rest[edges[:, 1]]) ** 2, axis=1)
    return net * area / square


def make_yarns(
    flat: np.ndarray, faces: np.ndarray, stiffness: float, *, damping_time: float = 0.0
) -> StencilBlock:
    """Make the yarns of a garment: constraints of unit length along weft and warp.

    Args:
        flat: Rest positions [m], shape (V, 2): the first axis is the weft, the second the warp.
        faces: Vertex indices, shape (F, 3).
        stiffness: Of each direction, per width [N/m].
        damping_time: Relaxation time of the damping [s].

    Returns:
        Constraints of the triangles; weights are the changes [1/m] of the weft vector with the
        second and third corner, and of the warp vector; compliance [1/(N m)].
    """
    if stiffness == 0:
        faces = faces[:0]
    corner = flat[faces]
    sides = (corner[:, 1:] - corner[:, :1]).swapaxes(1, 2)  # (F, 2, 2), sides as columns
    inverse = np.linalg.inv(sides)
    area = 0.5 * np.abs(np.linalg.det(sides))
    return StencilBlock(
        vertices=faces,
        weights=inverse.swapaxes(1, 2).reshape(-1, 4),
        compliance=1.0 / (stiffness * area) if stiffness > 0 else np.zeros(0),
        damping_time=damping_time,
    )
