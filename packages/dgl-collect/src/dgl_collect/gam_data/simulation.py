"""Simulation of one garment: held at some vertices, carried, released, settled."""

from dataclasses import replace

import numpy as np

from dgl_assets import Garment
from dgl_physics import (
    ClothMaterial,
    ModelBuilder,
    PhysicsError,
    Shape,
    SolidMaterial,
    SolverConfig,
)
from dgl_physics.measure import compute_strain
from dgl_physics.scene import Scene

__all__ = ["GLOVE", "GarmentSimulation", "add_garment", "find_grip"]

GLOVE = SolidMaterial(thickness=0.004)
"""Material of gloves: their layers lie 10 to 25 mm apart, so the contact thickness is small."""
GRIP = 0.03
"""Radius around a landmark within which both layers are gripped, on the flat garment [m]."""
SPEED = 0.8
"""Speed of carried grips [m/s]."""
DRAG = 1.5
"""Drag of cloth in air; hanging cloth comes to rest within seconds [1/s]."""
MEAN_STRAIN_LIMIT = 0.1
"""Largest mean change of edge length of a state. Crumpled coarse meshes reach 0.07, all else
0.03."""
_SUBSTEPS = 6  # of a frame of 1/60 s
_FINE = 2  # steps of a frame while something is carried, for small jumps


def add_garment(
    builder: ModelBuilder,
    garment: Garment,
    start: np.ndarray,
    *,
    material: ClothMaterial | None = None,
    pinned: np.ndarray | tuple[int, ...] = (),
) -> None:
    """Add a garment of the catalogue to a model: cloth as cloth, a shell as an elastic wall.

    Args:
        builder: Builder of the model.
        garment: Rest shape and wall thickness.
        start: Positions of the vertices [m], shape (V, 3); a shell is unstrained there.
        material: Material of cloth; the default when None. A shell has that of its category.
        pinned: Fixed vertices.
    """
    if garment.wall_thickness is None:
        builder.add_garment(
            start, garment.faces, rest=garment.rest_vertices, material=material, pinned=pinned
        )
    else:
        solid = GLOVE if garment.category == "Glove" else SolidMaterial()
        builder.add_solid(
            start, garment.faces, thickness=garment.wall_thickness, material=solid, pinned=pinned
        )


def find_grip(garment: Garment, landmark: str) -> np.ndarray:
    """Find the vertices that a hand holds at a landmark, of all layers there, shape (n,)."""
    away = garment.vertices - garment.vertices[garment.landmarks[landmark]]
    return np.flatnonzero(np.linalg.norm(away, axis=1) < GRIP)


class GarmentSimulation:
    """Simulations of one garment, each from given positions; cheap rather than exact."""

    def __init__(self, garment: Garment, material: ClothMaterial | None = None) -> None:
        """Prepare.

        Args:
            garment: A garment of the catalogue.
            material: Material of cloth; the default when None.
        """
        self.garment = garment
        self._material = replace(material or ClothMaterial(), drag=DRAG)

    def settle(
        self,
        start: np.ndarray,
        *,
        frames: int,
        pinned: np.ndarray | tuple[int, ...] = (),
        shapes: tuple[Shape, ...] = (),
    ) -> np.ndarray:
        """Release the garment, and simulate until it is calm.

        Args:
            start: Positions [m], shape (V, 3).
            frames: Most frames [1/60 s].
            pinned: Fixed vertices.
            shapes: Shapes of the world, besides the ground at z = 0.

        Returns:
            Positions [m], shape (V, 3).

        Raises:
            PhysicsError: If it cannot be simulated.
        """
        config = SolverConfig(substeps=_SUBSTEPS, sleep_after=0.25)
        scene = self._build(start, config, pinned, shapes)
        calm = round(config.sleep_after / config.dt)
        for _ in range(frames):
            scene.step()
            if scene.state.still.numpy()[0] >= calm:
                break
        return self._finish(scene)

    def carry(self, start: np.ndarray, grips: list[np.ndarray], paths: np.ndarray) -> np.ndarray:
        """Carry gripped vertices along paths, above the ground.

        Args:
            start: Positions [m], shape (V, 3).
            grips: Vertices of each grip.
            paths: Displacement of each grip every 1/60 s [m], shape (T, G, 3).

        Returns:
            Positions at the end [m], shape (V, 3).

        Raises:
            PhysicsError: If it cannot be simulated.
        """
        config = SolverConfig(dt=1 / 60 / _FINE, substeps=_SUBSTEPS // _FINE, sleep_distance=0.0)
        pinned = np.unique(np.concatenate(grips))
        owner = np.array([next(g for g, own in enumerate(grips) if v in own) for v in pinned])
        scene = self._build(start, config, pinned, ())
        times = np.arange(1, _FINE * (len(paths) - 1) + 1) / _FINE
        before = np.minimum(times.astype(int), len(paths) - 2)
        part = (times - before)[:, None, None]
        way = paths[before] * (1 - part) + paths[before + 1] * part
        held = scene.x[pinned]
        previous = paths[0]
        # Not by set_particles, after which the solver forgets what it measured: these vertices go
        # on as they did.
        state = scene.state
        for now in way:
            for array, values in (
                (state.positions, held + now[owner]),
                (state.velocities, ((now - previous) / config.dt)[owner]),
            ):
                all_values = array.numpy()
                all_values[pinned] = values
                array.assign(all_values)
            scene.step()
            previous = now
        return self._finish(scene)

    def press(self, start: np.ndarray, share: float) -> np.ndarray:
        """Press the garment by a horizontal plate, to a share below its height.

        Raises:
            PhysicsError: If it cannot be simulated.
        """
        half = 0.01
        plate = Shape(kind="box", size=(0.3, 0.3, half))
        scene = self._build(start, SolverConfig(), (), (plate,), is_moving=True)
        top, height = start[:, 2].max(), float(np.ptp(start[:, 2]))
        for part in np.append(np.linspace(-0.1, 1.0, 30), np.ones(10)):
            pose = [0.0, 0.0, top - part * share * height + half + 0.004, 1.0, 0.0, 0.0, 0.0]
            scene.move(np.array([pose]), is_jump=bool(part == -0.1))
            scene.step()
        return self._finish(scene)

    def _build(
        self,
        start: np.ndarray,
        config: SolverConfig,
        pinned: np.ndarray | tuple[int, ...],
        shapes: tuple[Shape, ...],
        *,
        is_moving: bool = False,
    ) -> Scene:
        builder = ModelBuilder()
        add_garment(builder, self.garment, start, material=self._material, pinned=pinned)
        builder.add_ground()
        for shape in shapes:
            builder.add_shape(shape, body=builder.add_body("plate") if is_moving else 0)
        return Scene(builder, config)

    def _finish(self, scene: Scene) -> np.ndarray:
        """Check the final state and return the surface."""
        if not np.isfinite(scene.x).all():
            raise PhysicsError("positions are not finite")
        (own,) = scene.model.garments
        strain = compute_strain(scene.x, own.edges, own.rest_lengths)
        mean = float(np.abs(strain).mean())
        if mean > MEAN_STRAIN_LIMIT:
            raise PhysicsError(
                f"the mean strain must be at most {MEAN_STRAIN_LIMIT}; got {mean:.3f}"
            )
        return scene.x[: len(self.garment.vertices)]
