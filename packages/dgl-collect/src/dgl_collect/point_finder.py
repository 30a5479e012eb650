"""Where the demonstration's points are on a garment that is seen, look after look."""

from collections.abc import Mapping, Sequence

import numpy as np

from dgl_assets.robots import SIDES, Side
from dgl_collect.formula import Value, evaluate_formula
from dgl_collect.steps import Demonstration, Grasp, Stage
from dgl_gam import GamError, Matcher, choose_pair, restrict_to_places
from dgl_tasks.errors import PerceptionError

HANDS_APART = 0.15
"""Least distance between the places that two hands take hold of [m]: nearer, the hands are in each other's way."""
APART = 0.25
"""Points farther from each other than this are not taken together by one hand [m]."""
PLACE_SCALE = 0.05
"""Distance from a place at which the affordance of the garment around it has fallen to exp(-1/2) [m] (original code)."""


class PointFinder:
    """Finds the demonstration's points in clouds of one garment, and remembers where they lay at first."""

    def __init__(self, demonstration: Demonstration, demo_cloud: np.ndarray) -> None:
        """Prepare an attempt.

        Args:
            demonstration: Whose points they are, and what its stages grasp.
            demo_cloud: Visible points of its garment lying flat [m], shape (N, 3).
        """
        self._demonstration, self._demo_cloud = demonstration, demo_cloud
        self._is_turned_over = False
        self.points: dict[str, np.ndarray] = {}
        """All points, where they lay when the garment was last looked at as a whole [m], shape (3,), world frame."""

    def look(self, cloud: np.ndarray, matcher: Matcher) -> None:
        """Look at the garment as a whole: where its points lie, and whether it lies on its face.

        Args:
            cloud: What is seen of it [m], shape (M, 3), world frame.
            matcher: Of the garment as it lies.
        """
        self._is_turned_over = False
        self.points = self.find_points(cloud, matcher)
        if self._demonstration.turns_over and self._is_crossed(self._demonstration.stages[0]):
            self._is_turned_over = True
            self.points = self.find_points(cloud, matcher)

    def find_points(self, cloud: np.ndarray, matcher: Matcher) -> dict[str, np.ndarray]:
        """Find all points in a cloud [m], shape (M, 3): each of shape (3,), world frame."""
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
        """Give the points that a stage's formulas use: found anew, or where they lay at first."""
        return self.find_points(cloud, matcher) if stage.looks_again else self.points

    def find_grasps(
        self, stage: Stage, cloud: np.ndarray, matcher: Matcher, names: Mapping[str, Value]
    ) -> tuple[dict[Side, np.ndarray], np.ndarray]:
        """Find what the hands of a stage take.

        Where the garment has been looked at before, points are looked for near their old places, see
        `Stage.moved_at_most`.

        Args:
            stage: The stage.
            cloud: What is seen of the garment [m], shape (M, 3), world frame.
            matcher: Of the garment as it lies.
            names: What the formulas of places may name.

        Returns:
            The point on the garment for each working hand [m], shape (3,), and the similarity of every point of
            the cloud to the places that the left and the right hand grasp, shape (2, M); of a hand that rests, to those
            of the other one.

        Raises:
            PerceptionError: If nothing of the garment is near where a point was.
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
        """Whether the left hand would grasp to the right of the right one."""
        x = {
            side: np.mean([self.points[name][0] for name in stage.grasp[side].points])
            for side in SIDES
        }
        return bool(x["left"] > x["right"])

    def _choose_grasp(self, names: Sequence[str], found: np.ndarray) -> np.ndarray:
        """Choose midway between points [m], shape (N, 3); of some that one hand cannot take together the one left behind."""
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
    """Whether each hand takes hold of a point of its own."""
    return all(side in stage.grasp and len(stage.grasp[side].points) == 1 for side in SIDES)


def _exchange_sides(name: str) -> str:
    for side, other in (SIDES, SIDES[::-1]):
        if name.startswith(f"{side}_"):
            return other + name.removeprefix(side)
    return name
