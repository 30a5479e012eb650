"""Two points for two hands, which cannot take hold of one place."""

import numpy as np


def choose_pair(
    found: np.ndarray, similarity: np.ndarray, cloud: np.ndarray, *, apart: float
) -> np.ndarray:
    """Choose two places for two wanted points that were found at one.

    Garments are nearly symmetric: in a heap of which one side is hidden, both of its points look
    most like the other side, and would be found at one place.

    Args:
        found: Index of the most similar point for each of the two, shape (2,).
        similarity: Of each point of the cloud to both wanted points, shape (2, M).
        cloud: Observed points [m], shape (M, 3), world frame.
        apart: Least horizontal distance between the chosen points [m]; a cloud that is nowhere as
            wide has none.

    Returns:
        What was found, if it is that far apart; else, where there is one, the pair that is, with
        the largest sum of similarities; shape (2,), int64.

    Raises:
        ValueError: If the shapes do not fit together.
    """
    found, similarity, cloud = np.asarray(found), np.asarray(similarity), np.asarray(cloud)
    if found.shape != (2,) or similarity.shape != (2, len(cloud)) or cloud.shape[1:] != (3,):
        raise ValueError(
            "found must have shape (2,) and similarity (2, M) for a cloud (M, 3); "
            f"got {found.shape}, {similarity.shape} and {cloud.shape}"
        )
    flat = cloud[:, :2]
    if np.linalg.norm(flat[found[0]] - flat[found[1]]) >= apart:
        return found
    is_apart = np.linalg.norm(flat[:, None] - flat[None], axis=2) >= apart
    if not is_apart.any():
        return found
    total = np.where(is_apart, similarity[0][:, None] + similarity[1][None], -np.inf)
    return np.array(np.unravel_index(total.argmax(), total.shape))
