"""Components of an attempt: the functions through which each is called."""

from collections.abc import Mapping, Sequence
from types import MappingProxyType

__all__ = ["COMPONENTS", "REST", "STEP"]

STEP = "controllers"
"""The component whose first call is the first control step."""
REST = "rest"
"""Time outside all other components."""

COMPONENTS: Mapping[str, Sequence[str]] = MappingProxyType(
    {
        "cloth solver": ("dgl_physics.solver:SolverXPBD.step",),
        "cloth, Python": (
            "dgl_physics.sapien_bridge:SapienCloth.step",
            "dgl_physics.sapien_bridge:SapienCloth.apply_forces",
        ),
        "film, pictures": ("dgl_tasks.env:GarmentEnv.film",),
        "film, encoding": (
            "dgl_collect.video:VideoWriter.add",
            "dgl_collect.video:VideoWriter.__exit__",
        ),
        "sensor pictures": ("dgl_tasks.env:GarmentEnv.take_picture",),
        "clouds": (
            "dgl_tasks.perception:get_garment_points",
            "dgl_tasks.perception:get_garment_cloud",
            "dgl_tasks.perception:get_environment_cloud",
        ),
        "meshes in pictures": ("dgl_tasks.appearance:Appearance.get_rasteriser",),
        "PhysX": ("mani_skill.envs.scene:ManiSkillScene.step",),
        STEP: ("dgl_tasks.env:GarmentEnv.advance",),
        "reset": ("dgl_tasks.env:GarmentEnv.reset",),
        "planning of motions": (
            "dgl_tasks.motion:BimanualMotion.choose_turns",
            "dgl_tasks.motion:BimanualMotion.move",
            "dgl_tasks.motion:BimanualMotion.reach",
            "dgl_tasks.motion:BimanualMotion.move_joints",
        ),
        "strain and penetration": (
            "dgl_physics.sapien_bridge:SapienCloth.measure_strain",
            "dgl_physics.solver:SolverXPBD.measure_penetration",
        ),
        "episode file": ("dgl_collect.attempt:write_episode",),
    }
)
"""Functions by component. The innermost one counts: a picture that is taken in a reset is a
picture."""
