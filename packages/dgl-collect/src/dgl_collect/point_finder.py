"""Search for the points of a demonstration in clouds of another garment."""

from collections.abc import Mapping, Sequence

import numpy as np

from dgl_assets.robots import SIDES, Side
from dgl_collect.formula import Value, evaluate_formula
from dgl_collect.steps import Demonstration, Grasp, Stage
from dgl_gam import GamError, Matcher, choose_pair, restrict_to_places
from dgl_tasks.errors import PerceptionError

HANDS_APART = 0.15
"""Least distance between the grasp points of two hands, against collisions [m]."""
APART = 0.25
"""Largest distance between points that one hand grasps together [m]."""
PLACE_SCALE = 0.05
"""Distance at which the affordance around a grasp point falls to exp(-1/2) [m] (original code)."""


class PointFinder:
    """Finds the points of a demonstration on one garment, and remembers their first positions."""

    def __init__(self, demonstration: Demonstration, demo_cloud: np.ndarray) -> None:
        """Prepare an attempt.

        Args:
            demonstration: Its points and the grasps of its stages.
            demo_cloud: Visible points of its garment lying flat [m], shape (N, 3).
        """
        self._demonstration, self._demo_cloud = demonstration, demo_cloud
        self._is_turned_over = False
        self.points: dict[str, np.ndarray] = {}
        """Positions of all points at the last `look` [m], shape (3,), world frame."""

    def look(self, cloud: np.ndarray, matcher: Matcher) -> None:
        """Find all points, and check if the garment lies face down.

        Args:
            cloud: Visible points of the garment [m], shape (M, 3), world frame.
            matcher: Of the garment in its present state.
        """
        self._is_turned_over = False
        self.points = self.find_points(cloud, matcher)
        if self._demonstration.turns_over and self._is_crossed(self._demonstration.stages[0]):
            self._is_turned_over = True
            self.points = self.find_points(cloud, matcher)

    def find_points(self, cloud: np.ndarray, matcher: Matcher) -> dict[str, np.ndarray]:
        """Find all points in a cloud [m], shape (M, 3); each has shape (3,), world frame."""
        names = list(self._demonstration.points)
        if not names:
            return {}
        found, similarity = self._match(names, cloud, matcher)
        for stage in filter(_has_pair, self._demonstration.stages):
            rows = [names.index(name) for side in SIDES for name in stage.grasp[side].points]
            found[rows] = choose_pair(found[rows], similarity[rows], cloud, apart=HANDS_APART)
        return {n: cloud[i].astype(np.float64) for n, i in zip(names, found, strict=True)}

    def find_stage_points(
        self, stage: Stage, cloud: np.ndarray, matcher: Matcher
    ) -> dict[str, np.ndarray]:
        """Return the points for a stage's formulas, found again if the stage asks for it."""
        return self.find_points(cloud, matcher) if stage.looks_again else self.points

    def find_grasps(
        self, stage: Stage, cloud: np.ndarray, matcher: Matcher, names: Mapping[str, Value]
    ) -> tuple[dict[Side, np.ndarray], np.ndarray]:
        """Find the grasp points of a stage.

        After a first `look`, points are searched near their first positions; see
        `Stage.moved_at_most`.

        Args:
            stage: The stage.
            cloud: Seen points of the garment [m], shape (M, 3), world frame.
            matcher: Of the garment in its present state.
            names: Names for formulas; see `name_scene`.

        Returns:
            The grasp point of each working hand [m], shape (3,), and the similarity of every cloud
            point to those of the left and the right hand, shape (2, M); a resting hand has the
            other one's.

        Raises:
            PerceptionError: If nothing of the garment is near the first position of a point.
        """
        grasp: dict[Side, np.ndarray] = {}
        similarities, pair = [], []
        for side in SIDES:
            wanted = stage.grasp.get(side) or next(iter(stage.grasp.values()))
            if wanted.at is not None:
                place = np.array([evaluate_formula(formula, names) for formula in wanted.at])
                distance = np.linalg.norm(cloud - place, axis=1)
                similarities.append(np.exp(-0.5 * (distance / PLACE_SCALE) ** 2))
                found = place[None]
            else:
                index, similarity = self._find_near(stage, wanted, cloud, matcher)
                similarities.append(similarity.max(axis=0))
                pair.append(index[0])
                found = cloud[index]
            if side in stage.grasp:
                grasp[side] = self._choose_grasp(wanted.points, found)
        if _has_pair(stage):
            pair = choose_pair(np.stack(pair), np.stack(similarities), cloud, apart=HANDS_APART)
            grasp = {side: cloud[i].astype(float) for side, i in zip(SIDES, pair, strict=True)}
        return grasp, np.stack(similarities)

    def _find_near(
        self, stage: Stage, wanted: Grasp, cloud: np.ndarray, matcher: Matcher
    ) -> tuple[np.ndarray, np.ndarray]:
        found, similarity = self._match(wanted.points, cloud, matcher)
        if self.points and stage.moved_at_most is not None:
            places = np.array([self.points[name] for name in wanted.points])
            try:
                return restrict_to_places(similarity, cloud, places, radius=stage.moved_at_most)
            except GamError as err:
                raise PerceptionError(f"{stage.name}: {err}") from err
        return found, similarity

    def _is_crossed(self, stage: Stage) -> bool:
        """Check if the left hand would grasp to the right of the right hand."""
        x = {
            side: np.mean([self.points[name][0] for name in stage.grasp[side].points])
            for side in SIDES
        }
        return bool(x["left"] > x["right"])

    def _choose_grasp(self, names: Sequence[str], found: np.ndarray) -> np.ndarray:
        """Average points [m], shape (N, 3); if far apart, take the one that moved least."""
        distances = np.linalg.norm(found[:, None] - found[None], axis=2)
        if self.points and distances.max() > APART:
            moved = [np.linalg.norm(p - self.points[n]) for n, p in zip(names, found, strict=True)]
            return found[int(np.argmin(moved))].astype(float)
        return found.mean(axis=0, dtype=float)

    def _match(
        self, names: Sequence[str], cloud: np.ndarray, matcher: Matcher
    ) -> tuple[np.ndarray, np.ndarray]:
        if self._is_turned_over:
            names = [_exchange_sides(name) for name in names]
        wanted = np.array([self._demonstration.points[name] for name in names])
        return matcher.match(self._demo_cloud, wanted, cloud)


def _has_pair(stage: Stage) -> bool:
    """Check that each hand grasps one point of its own."""
    return all(side in stage.grasp and len(stage.grasp[side].points) == 1 for side in SIDES)


def _exchange_sides(name: str) -> str:
    for side, other in (SIDES, SIDES[::-1]):
        if name.startswith(f"{side}_"):
            return other + name.removeprefix(side)
    return name
