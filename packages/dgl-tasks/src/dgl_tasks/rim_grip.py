"""Help that no robot has: closed hands to which the rim of a garment sticks."""

from collections.abc import Mapping

import numpy as np

from dgl_assets.importing.topology import find_loops
from dgl_assets.robots import SIDES, Robot, Side
from dgl_physics.sapien_bridge import SapienCloth
from dgl_tasks.grasps import wrist_to_grasp
from dgl_tasks.hand_span import HandSpan
from dgl_tasks.observation import CONTROL_FREQUENCY
from dgl_tasks.rotations import to_rotation

CLOSED = 0.5
"""Share of the way from open to a pose that grasps, from which a hand counts as closed."""
_GRASPS = [HandSpan.names.index(name) for name in ("close", "pinch")]


class RimGrip:
    """Holds an arc of a garment's opening that was near a hand when it closed.

    Its vertices keep their places in the hand's frame until the hand's joint targets are less than
    half closed.
    """

    def __init__(self, faces: np.ndarray, reach: float, robot: Robot) -> None:
        """Find the openings.

        Args:
            faces: Triangles of the garment, shape (F, 3).
            reach: Largest distance of the opening from the grasp point of the hand, and length of
                the arc to either side of the nearest vertex [m].
            robot: Whose hands they are.
        """
        self._loops = find_loops(faces)
        self._rim = np.unique(np.concatenate([np.empty(0, dtype=int), *self._loops]))
        self._reach, self._robot, self._span = reach, robot, HandSpan(robot)
        self._held: dict[Side, tuple[np.ndarray, np.ndarray]] = {}
        self._carries = False

    @property
    def counts(self) -> Mapping[Side, int]:
        """Number of vertices that each hand holds."""
        return {side: len(self._held[side][0]) if side in self._held else 0 for side in SIDES}

    def update(self, cloth: SapienCloth, hands: np.ndarray, targets: np.ndarray) -> None:
        """Take, carry or let go of vertices, before a step of the cloth.

        Args:
            cloth: Simulation, whose first particles are the vertices.
            hands: Poses of `ee`, left and right, xyz [m] and wxyz, shape (2, 7).
            targets: Of the joints [rad], shape (D,).
        """
        for side, pose in zip(SIDES, hands, strict=True):
            joints = targets[self._robot.joint_slice(side, "hand")]
            is_closed = self._span.to_coordinates(joints)[_GRASPS].sum() > CLOSED
            if is_closed and side not in self._held:
                vertices = cloth.state.get_positions()[0]
                grasp = wrist_to_grasp(pose[:3], pose[3:], side, robot=self._robot)
                arc = self._find_arc(vertices, grasp)
                local = to_rotation(pose[3:]).inv().apply(vertices[arc] - pose[:3])
                # in the precision of states, so that a restored hand goes on alike
                self._held[side] = arc, local.astype(np.float32)
            elif not is_closed:
                self._held.pop(side, None)
        if self._held or self._carries:
            self._carry(cloth, hands)

    def _find_arc(self, vertices: np.ndarray, grasp: np.ndarray) -> np.ndarray:
        """Find the vertices of the arc near a grasp point, sorted, shape (N,)."""
        distances = np.linalg.norm(vertices - grasp, axis=1)
        for taken, _ in self._held.values():
            distances[taken] = np.inf
        if not len(self._rim) or distances[self._rim].min() > self._reach:
            return self._rim[:0]
        loop = min(self._loops, key=lambda each: distances[each].min())
        loop = np.roll(loop, -distances[loop].argmin())
        steps = np.linalg.norm(vertices[np.roll(loop, -1)] - vertices[loop], axis=1)
        forth = np.cumsum(steps) - steps
        arc = loop[np.minimum(forth, steps.sum() - forth) <= self._reach]
        return np.sort(arc[np.isfinite(distances[arc])])

    def _carry(self, cloth: SapienCloth, hands: np.ndarray) -> None:
        places: dict[int, np.ndarray] = {}
        for side, pose in zip(SIDES, hands, strict=True):
            if side in self._held:
                particles, local = self._held[side]
                places |= zip(
                    particles.tolist(), to_rotation(pose[3:]).apply(local) + pose[:3], strict=True
                )
        particles = np.fromiter(places, dtype=int)
        positions = np.reshape(list(places.values()), (-1, 3))
        before = cloth.state.get_positions()[0][particles]
        cloth.state.hold(particles, positions, (positions - before) * CONTROL_FREQUENCY)
        self._carries = bool(self._held)

    def read_state(self) -> np.ndarray:
        """Give what each hand holds, shape (2 * (1 + 4 * R),) for R vertices at openings.

        For each hand: 1 if it is closed, and for each vertex 1 if it is held, and its place in
        the hand's frame [m].
        """
        rows = np.zeros((2, 1 + 4 * len(self._rim)), dtype=np.float32)
        for side, (particles, local) in self._held.items():
            hand = rows[SIDES.index(side)]
            hand[0] = 1.0
            at = np.searchsorted(self._rim, particles)
            hand[1:].reshape(-1, 4)[at] = np.column_stack([np.ones(len(at)), local])
        return rows.ravel()

    def write_state(self, state: np.ndarray) -> None:
        """Restore the result of `read_state`."""
        self._held, self._carries = {}, True  # what is held now is let go
        for side, hand in zip(SIDES, np.reshape(state, (2, -1)), strict=True):
            if hand[0]:
                rows = hand[1:].reshape(-1, 4)
                held = rows[:, 0] > 0
                self._held[side] = self._rim[held], rows[held, 1:].astype(np.float32)
