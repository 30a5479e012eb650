"""Match two towels by their normalised positions, without a network.

Example: python examples/affordance_of_a_rule.py
"""

import numpy as np

from dgl_gam import Matcher, compute_affordance, normalize_cloud


class NearestInNormalForm:
    """Matches a point to the point nearest to it once both garments are in normal form.

    Enough for flat garments of one cut and one orientation; it knows nothing of sleeves.
    """

    def match(
        self, source_cloud: np.ndarray, source_points: np.ndarray, target_cloud: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Match as `dgl_gam.Matcher` says; the similarity is exp(-distance)."""
        _, source_map = normalize_cloud(source_cloud)
        target, _ = normalize_cloud(target_cloud)
        points = source_map.apply(source_points)
        distance = np.linalg.norm(points[:, None] - target[None], axis=2)  # (K, M)
        similarity = np.exp(-distance).astype(np.float32)
        return similarity.argmax(axis=1).astype(np.int64), similarity


def make_towel(rng: np.random.Generator, *, width: float, length: float) -> np.ndarray:
    """Sample 512 points [m], shape (512, 3), of a flat towel centred at the origin."""
    points = np.zeros((512, 3))
    points[:, :2] = (rng.random((512, 2)) - 0.5) * (width, length)
    return points


def main(seed: int = 0) -> dict[str, float]:
    """Match corners of two different towels; return the largest error [m]."""
    rng = np.random.default_rng(seed)
    source = make_towel(rng, width=0.4, length=0.6)
    shift = np.array([1.0, 0.5, 0.2])
    target = make_towel(rng, width=0.8, length=1.2) + shift
    corners = np.array([[-0.2, -0.3, 0.0], [0.2, 0.3, 0.0]])  # (K, 3)

    matcher: Matcher = NearestInNormalForm()
    indices, similarity = matcher.match(source, corners, target)
    affordance = compute_affordance(similarity)  # (M, 2)

    error = np.linalg.norm(target[indices] - (2 * corners + shift), axis=1)
    return {
        "largest_error_m": float(error.max()),
        "affordance_at_matches": float(affordance[indices, [0, 1]].min()),
    }


if __name__ == "__main__":
    print(main())
