"""Finding a point again that was seen before: among what lies near its old place."""

import numpy as np

from dgl_gam.errors import GamError


def restrict_to_places(
    similarity: np.ndarray, cloud: np.ndarray, places: np.ndarray, *, radius: float
) -> tuple[np.ndarray, np.ndarray]:
    """Choose the most similar point near the place of each point, whatever looks alike elsewhere.

    Folded garments lose what tells left from right and top from bottom. Who saw them flat still
    knows.

    Args:
        similarity: Of each point of the cloud to each wanted point, shape (K, M).
        cloud: Observed points [m], shape (M, 3), world frame.
        places: Where each wanted point was seen before [m], shape (K, 3), world frame.
        radius: Horizontal distance that it may have moved since [m].

    Returns:
        Index of the best point, shape (K,), int64, and the similarity with its least value of a row
        wherever the point cannot be, shape (K, M).

    Raises:
        ValueError: If the shapes do not fit together.
        GamError: If nothing of the cloud is near one of the places.
    """
    similarity, cloud, places = np.asarray(similarity), np.asarray(cloud), np.asarray(places)
    if similarity.shape != (len(places), len(cloud)) or cloud.shape[1:] != (3,):
        raise ValueError(
            "similarity must have shape (K, M) for places (K, 3) and a cloud (M, 3); got "
            f"{similarity.shape}, {places.shape} and {cloud.shape}"
        )
    distance = np.linalg.norm(cloud[None, :, :2] - places[:, None, :2], axis=2)
    near = distance <= radius
    lost = ~near.any(axis=1)
    if lost.any():
        x, y = places[lost.argmax(), :2]
        raise GamError(f"nothing of the garment lies within {radius} m of ({x:.2f}, {y:.2f}) m")
    best = np.where(near, similarity, -np.inf).argmax(axis=1)
    return best, np.where(near, similarity, similarity.min(axis=1, keepdims=True))
