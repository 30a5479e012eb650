"""Alignment of recordings in time, and the knots that describe their common course."""

import numpy as np

__all__ = ["align", "choose_knots"]

_HURRY = 0.02
"""Length that the whole time counts for [m]; it spreads pauses evenly."""


def align(wanted: np.ndarray, course: np.ndarray) -> np.ndarray:
    """Align a course with another one by dynamic time warping.

    Args:
        wanted: Features of comparable scale [m], shape (T, C).
        course: Likewise, shape (U, C).

    Returns:
        The frame of the course that corresponds to each frame of the wanted one, fractional and not
        decreasing, shape (T,); the first and last frames correspond.

    Source:
        Sakoe and Chiba, "Dynamic programming algorithm optimization for spoken word recognition",
        1978.
    """
    rows, columns = len(wanted), len(course)
    shares = np.linspace(0, 1, rows)[:, None] - np.linspace(0, 1, columns)[None]
    cost = np.linalg.norm(wanted[:, None] - course[None], axis=2) + _HURRY * np.abs(shares)
    total = np.full((rows + 1, columns + 1), np.inf)
    total[0, 0] = 0.0
    for i in range(rows):
        for j in range(columns):
            total[i + 1, j + 1] = cost[i, j] + min(total[i, j], total[i, j + 1], total[i + 1, j])
    i, j = rows - 1, columns - 1
    matched: list[list[int]] = [[] for _ in range(rows)]
    while True:
        matched[i].append(j)
        if i == 0 and j == 0:
            break
        steps = {(1, 1): total[i, j], (1, 0): total[i, j + 1], (0, 1): total[i + 1, j]}
        back = min(steps, key=lambda step: steps[step])
        i, j = i - back[0], j - back[1]
    frames = np.array([np.mean(each) for each in matched])
    frames[0], frames[-1] = 0.0, columns - 1.0
    return frames


def choose_knots(course: np.ndarray, *, within: float) -> np.ndarray:
    """Choose frames between which a course is straight.

    Args:
        course: Features of comparable scale, shape (T, C).
        within: Largest distance of a frame from the line between its knots.

    Returns:
        Frames, increasing, the first and the last among them.

    Source:
        Douglas and Peucker, "Algorithms for the reduction of the number of points", 1973; here the
        distance is measured at equal times.
    """
    knots = {0, len(course) - 1}
    spans = [(0, len(course) - 1)]
    while spans:
        first, last = spans.pop()
        if last - first < 2:
            continue
        share = np.linspace(0, 1, last - first + 1)[:, None]
        line = course[first] + share * (course[last] - course[first])
        distance = np.linalg.norm(course[first : last + 1] - line, axis=1)
        worst = first + int(distance.argmax())
        if distance.max() > within:
            knots.add(worst)
            spans += [(first, worst), (worst, last)]
    return np.array(sorted(knots))
