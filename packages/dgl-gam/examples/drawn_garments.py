"""Errors of the weights on hand-drawn outlines with named corners.

Each outline is the right half of a garment lying flat, from the middle of the neck or waist to the
middle of the hem or the crotch, [m]. Its corners are found from those of the garments that come
along.

Example: python examples/drawn_garments.py
"""

import numpy as np

from dgl_gam import GarmentAffordanceModel
from dgl_gam.samples import load_samples

Half = list[tuple[float, float, str]]
"""Corners in their order: x, y, and the landmark's name, or none where the outline merely bends."""

NECK, UPPER, LOWER, ARMPIT, HEM = "neck_side", "cuff_upper", "cuff_lower", "armpit", "hem_corner"
WAIST, OUTER, INNER = "waist_corner", "hem_outer_corner", "hem_inner_corner"

# fmt: off
OUTLINES: dict[str, dict[str, Half]] = {
    "Tops_LongSleeve": {
        "v-neck": [(0, .17, ""), (.09, .33, NECK), (.22, .30, ""), (.52, -.04, UPPER),
            (.48, -.10, LOWER), (.24, .12, ARMPIT),
                   (.24, -.32, HEM), (0, -.32, "")],
        "boat neck": [(0, .29, ""), (.17, .31, NECK), (.23, .29, ""), (.55, .0, UPPER),
            (.52, -.06, LOWER), (.25, .12, ARMPIT),
                      (.25, -.30, HEM), (0, -.30, "")],
        "turtleneck": [(0, .39, ""), (.07, .39, ""), (.08, .30, NECK), (.21, .27, ""),
            (.50, -.05, UPPER), (.46, -.10, LOWER),
                       (.23, .10, ARMPIT), (.23, -.33, HEM), (0, -.33, "")],
        "batwing": [(0, .25, ""), (.10, .30, NECK), (.25, .28, ""), (.62, .06, UPPER),
            (.60, -.02, LOWER), (.42, -.01, ""),
                    (.33, -.04, ""), (.26, -.12, ARMPIT), (.22, -.30, HEM), (0, -.30, "")],
        "bell sleeves": [(0, .25, ""), (.09, .30, NECK), (.21, .27, ""), (.58, .04, UPPER),
            (.46, -.16, LOWER),
                         (.23, .12, ARMPIT), (.24, -.32, HEM), (0, -.32, "")],
        "cropped": [(0, .17, ""), (.09, .22, NECK), (.22, .19, ""), (.52, -.10, UPPER),
            (.48, -.15, LOWER), (.25, .03, ARMPIT),
                    (.25, -.12, HEM), (0, -.12, "")],
        "peplum": [(0, .24, ""), (.09, .32, NECK), (.20, .29, ""), (.50, -.02, UPPER),
            (.46, -.07, LOWER), (.22, .12, ARMPIT),
                   (.19, -.02, ""), (.22, -.14, ""), (.32, -.32, HEM), (0, -.36, "")],
        "tunic": [(0, .32, ""), (.09, .38, NECK), (.22, .35, ""), (.52, .02, UPPER),
            (.48, -.04, LOWER), (.25, .16, ARMPIT),
                  (.25, -.34, HEM), (.12, -.42, ""), (0, -.43, "")],
        "drop shoulder": [(0, .28, ""), (.10, .33, NECK), (.34, .28, ""), (.60, .0, UPPER),
            (.54, -.10, LOWER),
                          (.33, .07, ARMPIT), (.33, -.33, HEM), (0, -.33, "")],
        "short sleeves": [(0, .26, ""), (.09, .32, NECK), (.22, .29, ""), (.38, .17, UPPER),
            (.33, .08, LOWER),
                          (.25, .12, ARMPIT), (.25, -.32, HEM), (0, -.32, "")],
    },
    "Dress_LongSleeve": {
        "a-line": [(0, .44, ""), (.09, .52, NECK), (.20, .49, ""), (.48, .20, UPPER),
            (.44, .14, LOWER), (.21, .32, ARMPIT),
                   (.19, .10, ""), (.42, -.50, HEM), (0, -.53, "")],
        "mermaid": [(0, .45, ""), (.09, .55, NECK), (.20, .52, ""), (.48, .22, UPPER),
            (.44, .17, LOWER), (.20, .36, ARMPIT),
                    (.18, .05, ""), (.19, -.20, ""), (.34, -.55, HEM), (0, -.55, "")],
        "shirt": [(0, .43, ""), (.09, .48, NECK), (.23, .45, ""), (.52, .12, UPPER),
            (.48, .06, LOWER), (.25, .27, ARMPIT),
                  (.27, -.45, HEM), (0, -.50, "")],
        "bell sleeves": [(0, .37, ""), (.12, .42, NECK), (.20, .40, ""), (.52, .20, UPPER),
            (.42, .04, LOWER), (.22, .25, ARMPIT),
                         (.19, .06, ""), (.34, -.30, HEM), (0, -.30, "")],
    },
    "Trousers": {
        "flared": [(0, .50, ""), (.18, .50, WAIST), (.22, .30, ""), (.19, -.10, ""),
            (.30, -.50, OUTER), (.06, -.50, INNER),
                   (.05, -.10, ""), (0, .18, "crotch")],
        "skinny": [(0, .50, ""), (.17, .50, WAIST), (.21, .32, ""), (.19, .0, ""),
            (.17, -.50, OUTER), (.08, -.50, INNER),
                   (0, .22, "crotch")],
        "palazzo": [(0, .50, ""), (.17, .50, WAIST), (.22, .32, ""), (.38, -.48, OUTER),
            (.04, -.50, INNER), (0, .18, "crotch")],
        "balloon": [(0, .55, ""), (.15, .55, WAIST), (.20, .40, ""), (.28, .0, ""),
            (.18, -.45, OUTER), (.10, -.46, INNER),
                    (0, .20, "crotch")],
        "shorts": [(0, .25, ""), (.19, .25, WAIST), (.23, .10, ""), (.26, -.18, OUTER),
            (.05, -.20, INNER), (0, -.02, "crotch")],
        "harem": [(0, .48, ""), (.18, .48, WAIST), (.28, .20, ""), (.27, -.10, ""),
            (.17, -.45, OUTER), (.08, -.46, INNER),
                  (0, -.08, "crotch")],
        "capri": [(0, .40, ""), (.18, .40, WAIST), (.22, .22, ""), (.20, -.28, OUTER),
            (.08, -.29, INNER), (0, .10, "crotch")],
    },
}
# fmt: on


def fill(half: Half, rng: np.random.Generator, count: int = 2048) -> np.ndarray:
    """Draw points [m], shape (count, 3), inside an outline and its mirror image."""
    corners = np.array([corner[:2] for corner in half])
    low, high = corners.min(axis=0), corners.max(axis=0)
    places = rng.uniform([0, low[1]], high, (20 * count, 2))
    start, end = corners, np.roll(corners, -1, axis=0)
    above = (start[:, 1] > places[:, 1:]) != (end[:, 1] > places[:, 1:])  # (n, edges)
    with np.errstate(divide="ignore", invalid="ignore"):
        along = (places[:, 1:] - start[:, 1]) / (end[:, 1] - start[:, 1])
    crosses = above & (places[:, :1] < start[:, 0] + along * (end[:, 0] - start[:, 0]))
    inside = places[crosses.sum(axis=1) % 2 == 1][:count]
    inside[:, 0] *= rng.choice([-1.0, 1.0], len(inside))
    return np.c_[inside, rng.uniform(0, 0.004, len(inside))]


def get_corners(half: Half) -> dict[str, np.ndarray]:
    """Names and positions [m] of an outline's corners on both sides; "left" is at -x."""
    corners = {}
    for x, y, name in half:
        if name == "crotch":
            corners[name] = np.array([x, y])
        elif name:
            corners |= {f"left_{name}": np.array([-x, y]), f"right_{name}": np.array([x, y])}
    return corners


def measure(category: str, half: Half, rng: np.random.Generator) -> np.ndarray:
    """Compute errors of corners, as shares of the diagonal, turned by up to 30 degrees."""
    model = GarmentAffordanceModel.load(category)
    cloud, corners = fill(half, rng), get_corners(half)
    wanted = np.array(list(corners.values()))
    errors = []
    for shown in load_samples(category):
        names = shown.header.landmark_names
        points = shown.states[0][[shown.landmarks[names.index(name)] for name in corners]]
        yaw = rng.uniform(-np.pi / 6, np.pi / 6)
        c, s = np.cos(yaw), np.sin(yaw)
        observed = cloud @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
        indices, _ = model.match(shown.view_points[0], points, observed)
        errors.append(np.linalg.norm(cloud[indices, :2] - wanted, axis=1))
    return np.concatenate(errors) / np.linalg.norm(np.ptp(cloud[:, :2], axis=0))


def main(seed: int = 0) -> dict[str, dict[str, float]]:
    """Compute mean errors of outlines by category; "all" is a category's mean."""
    rng = np.random.default_rng(seed)
    results = {}
    for category, outlines in OUTLINES.items():
        errors = {name: measure(category, half, rng) for name, half in outlines.items()}
        results[category] = {name: float(e.mean()) for name, e in errors.items()}
        every = np.concatenate(list(errors.values()))
        results[category]["all"] = float(every.mean())
        results[category]["PCK@.05"] = float((every <= 0.05).mean())
        results[category]["PCK@.10"] = float((every <= 0.10).mean())
    return results


if __name__ == "__main__":
    for category, errors in main().items():
        print(category, ", ".join(f"{name} {value:.1%}" for name, value in errors.items()))
