"""Page of two garments: landmarks, canonical colours, and a picked point found on the other."""

import threading
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from dgl_assets import Garment, correspond, load_garment
from dgl_assets.errors import AssetError

if TYPE_CHECKING:
    from viser import ViserServer

__all__ = ["GarmentPage", "find_nearest"]

APART = 1.4
"""Distance between the middles of the garments [m]."""
FABRIC, PICKED, FOUND = (120, 150, 175), (250, 190, 20), (220, 60, 30)
CAMERA, TARGET = (0.0, -0.7, 1.6), (0.0, 0.55, 0.0)
"""Place of the camera at the beginning, and where it looks [m]."""
LANDMARK = (40, 90, 200)
CLOUD_SIZE = 2048
LIFT = np.array([0.0, 0.0, 0.01])
"""Of a cloud above the cloth that it would be hidden in [m]."""


def find_nearest(vertices: np.ndarray, origin: np.ndarray, direction: np.ndarray) -> int:
    """Find the vertex that a ray from the camera meets first: near it, and in front.

    Args:
        vertices: [m], shape (V, 3).
        origin: Of the ray [m], shape (3,).
        direction: Unit vector, shape (3,).
    """
    to = vertices - origin
    along = to @ direction
    off = np.linalg.norm(to - along[:, None] * direction, axis=1)
    return int(np.argmin(off + 0.05 * along))


class GarmentPage:
    """Shows two garments; a click on the first is found on the second."""

    def __init__(
        self, server: "ViserServer", first: str, second: str, *, matcher: Literal["exact", "gam"]
    ) -> None:
        """Load the garments, and add the controls.

        Raises:
            AssetError: If a garment cannot be loaded.
            ValueError: If they are of different categories.
        """
        self._server = server
        self._models: dict[str, Any] = {}
        self._lock = threading.RLock()  # controls and clicks come in threads of their own
        server.initial_camera.position, server.initial_camera.look_at = CAMERA, TARGET
        gui = server.gui
        self.names = tuple(
            gui.add_text(label, name) for label, name in (("garment", first), ("other", second))
        )
        self.matcher = gui.add_dropdown("matcher", ("exact", "gam"), initial_value=matcher)
        self.landmarks = gui.add_checkbox("landmarks", initial_value=True)
        self.labels = gui.add_checkbox("names of landmarks", initial_value=False)
        self.colours = gui.add_checkbox("canonical colours", initial_value=False)
        self.told = gui.add_markdown("Click on the left garment.")
        self._garments: list[Garment] = []
        self._shown: list[np.ndarray] = []
        for control in (*self.names, self.landmarks, self.labels, self.colours):
            control.on_update(lambda _: self._reload())
        self.load()

    def load(self) -> None:
        """Show the garments that are named.

        Raises:
            AssetError: If one cannot be loaded.
            ValueError: If they are of different categories.
        """
        with self._lock:
            self._load()

    def _load(self) -> None:
        garments = [load_garment(control.value) for control in self.names]
        kinds = {garment.category for garment in garments}
        if len(kinds) > 1:
            raise ValueError(f"garments must be of one category; got {', '.join(sorted(kinds))}")
        self._garments, self._shown = garments, []
        scene = self._server.scene
        scene.reset()
        scene.set_up_direction("+z")
        scene.add_grid("/floor", width=4, height=3, cell_size=0.25, position=(0, 0.5, -0.01))
        for number, garment in enumerate(garments):
            low, high = garment.vertices.min(axis=0), garment.vertices.max(axis=0)
            middle = [(2 * number - 1) * APART / 2, 0.6, 0.02]
            shown = garment.vertices - [*(low + high)[:2] / 2, low[2]] + middle
            self._shown.append(shown.astype(np.float32))
            mesh = scene.add_mesh_simple(
                f"/{number}/garment", self._shown[-1], garment.faces, color=FABRIC, side="double"
            )
            if number == 0:
                mesh.on_click(self._on_click)
            if self.landmarks.value:
                for name, vertex in garment.landmarks.items():
                    place = tuple(shown[vertex])
                    scene.add_icosphere(f"/{number}/{name}", 0.012, LANDMARK, position=place)
                    if self.labels.value:
                        scene.add_label(f"/{number}/{name}/label", name)
            if self.colours.value:
                scene.add_point_cloud(
                    f"/{number}/canonical", self._shown[-1], _colour(garment), point_size=0.01
                )

    def _reload(self) -> None:
        try:
            self.load()
        except (AssetError, ValueError) as err:
            self.told.content = f"**{err}**"
        else:
            self.told.content = "Click on the left garment."

    def _on_click(self, event: Any) -> None:
        ray = np.array(event.ray_origin), np.array(event.ray_direction)
        self.pick(find_nearest(self._shown[0], *ray))

    def pick(self, vertex: int) -> None:
        """Mark a vertex of the first garment, and the point that the matcher finds on the other."""
        with self._lock:
            self._pick(vertex)

    def _pick(self, vertex: int) -> None:
        first, second = self._garments
        shift = self._shown[1][0] - second.vertices[0]
        scene = self._server.scene
        scene.remove_by_name("/similarity")
        if self.matcher.value == "exact":
            found = correspond(first, first.vertices[vertex : vertex + 1], second)[0] + shift
            self.told.content = f"vertex {vertex}, found by exact correspondence"
        else:
            found, points, similarity = self._match(vertex)
            found, points = found + shift, points + shift
            best = float(similarity.max())
            shade = np.clip(similarity / max(best, 1e-9), 0, 1)[:, None] ** 4
            heat = (1 - shade) * 0.85 + shade * np.array(FOUND) / 255
            scene.add_point_cloud(
                "/similarity", (points + LIFT).astype(np.float32), heat, point_size=0.01
            )
            self.told.content = f"vertex {vertex}, found by the affordance model, {best:.2f}"
        for name, place, colour in (
            ("/picked", self._shown[0][vertex], PICKED),
            ("/found", found, FOUND),
        ):
            scene.add_icosphere(name, 0.02, colour, position=tuple(place))

    def _match(self, vertex: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Find a vertex by the Garment Affordance Model: the point, the cloud, the similarity."""
        from dgl_gam import GarmentAffordanceModel
        from dgl_tasks.coverage import sample_visible_surface

        first, second = self._garments
        if first.category not in self._models:
            self._models[first.category] = GarmentAffordanceModel.load(first.category)
        clouds = []
        for garment in (first, second):
            cloud = sample_visible_surface(garment.vertices, garment.faces).astype(np.float32)
            rows = np.random.default_rng(0).choice(len(cloud), CLOUD_SIZE, len(cloud) < CLOUD_SIZE)
            clouds.append(cloud[rows])
        index, similarity = self._models[first.category].match(
            clouds[0], first.vertices[vertex : vertex + 1].astype(np.float32), clouds[1]
        )
        return clouds[1][index[0]], clouds[1], similarity[0]


def _colour(garment: Garment) -> np.ndarray:
    """Colour vertices by their canonical coordinates, shape (V, 3), in [0, 1]."""
    flat = garment.canonical[:, :2]
    low, high = flat.min(axis=0), flat.max(axis=0)
    u, v = ((flat - low) / np.maximum(high - low, 1e-9)).T
    return np.stack([u, v, 1 - u], axis=1).astype(np.float32)
