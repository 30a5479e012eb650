"""Store Tops: folded, and carried onto a platform."""

from dgl_physics import ClothMaterial
from dgl_tasks.declaration import HandFriction, SceneObject, Start, Task
from dgl_tasks.layouts import STORE_CAMERAS, STORE_LEFT_BASE, STORE_RIGHT_BASE
from dgl_tasks.success import RestsOn

TASK = Task(
    id="StoreTops-v1",
    title="Store Tops",
    category="Tops_NoSleeve",
    description="Fold a sleeveless top, take it up from below, and lay it on a platform.",
    success_text=(
        "the middle of what is seen of the garment from above is within 10 cm of the "
        "platform's, and at least 60 % of the garment lie on it"
    ),
    start=Start(x_range=(-0.05, 0.05), y_range=(0.65, 0.75)),
    objects=(
        SceneObject(
            name="platform",
            prop="platform",
            position=(0.0, 1.10, 0.0),
            x_range=(-0.30, 0.30),
            y_range=(-0.10, 0.10),
            solid_to="hands",
        ),
    ),
    left_base=STORE_LEFT_BASE,
    right_base=STORE_RIGHT_BASE,
    cameras=STORE_CAMERAS,
    # four layers are taken in one pinch
    material=ClothMaterial(particle_friction_scale=1.0),
    # fingers slide under what lies, and out again; with more at the thumb, it comes along
    hand_friction=HandFriction(fingers=1.0, thumb=3.0),
    success=RestsOn(frame="platform.top", within=0.10),
)
