"""The surface of a garment, to draw."""

import numpy as np

from dgl_physics.topology import compute_vertex_normals

_THICKNESS = 0.004  # of drawn cloth [m]


class GarmentSurface:
    """The outside of cloth, half its thickness off the particles: so the outer of two layers shows.

    Where the texture has a seam, a particle has several drawn vertices.
    """

    def __init__(self, faces: np.ndarray, uvs: np.ndarray) -> None:
        """Cut the surface where its texture has seams.

        Args:
            faces: Triangles of particles, shape (F, 3), seen from outside counter-clockwise.
            uvs: Texture coordinates in tiles of each particle, shape (V, 2), or of each corner,
                shape (F, 3, 2), where the two sides of a seam differ.
        """
        self._particle_faces = self.faces = np.asarray(faces, dtype=np.uint32)
        """Triangles of the drawn vertices, shape (F, 3), uint32."""
        self.uvs = np.ascontiguousarray(uvs, dtype=np.float32)
        """Texture coordinates of the drawn vertices, shape (W, 2), float32."""
        self._particles: np.ndarray | None = None
        if self.uvs.ndim == 3:
            self.faces, self.uvs, self._particles = _cut_seams(self.faces, self.uvs)

    def compute(self, positions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Compute the drawn surface.

        Args:
            positions: Of the particles [m], shape (V, 3), world frame.

        Returns:
            Vertices [m] and their normals, each of shape (W, 3).
        """
        positions = np.asarray(positions, dtype=np.float32)
        normals = compute_vertex_normals(positions, self._particle_faces)
        surface = positions + np.float32(_THICKNESS / 2) * normals
        if self._particles is None:
            return surface, normals
        return surface[self._particles], normals[self._particles]


def _cut_seams(
    faces: np.ndarray, corner_uvs: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Give every corner with its own texture coordinates a vertex of its own.

    Args:
        faces: Triangles of particles, shape (F, 3).
        corner_uvs: Texture coordinates of their corners, shape (F, 3, 2).

    Returns:
        Triangles, shape (F, 3), uint32; texture coordinates of their vertices, shape (W, 2),
        float32; and the particle of each vertex, shape (W,).
    """
    if corner_uvs.shape != (*faces.shape, 2):
        raise ValueError(
            f"uvs of corners must have shape {(*faces.shape, 2)}; got {corner_uvs.shape}"
        )
    corners = np.concatenate(
        [faces.reshape(-1, 1).astype(np.float64), corner_uvs.reshape(-1, 2)], axis=1
    )
    found, inverse = np.unique(corners, axis=0, return_inverse=True)
    return (
        inverse.reshape(faces.shape).astype(np.uint32),
        np.ascontiguousarray(found[:, 1:], dtype=np.float32),
        found[:, 0].astype(np.int64),
    )
