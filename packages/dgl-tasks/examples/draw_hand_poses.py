"""Let both hands take each of the six hand poses in SAPIEN, measure their rest, and draw them.

python packages/dgl-tasks/examples/draw_hand_poses.py docs/images/hand_poses.png
"""

import sys
import tempfile
from pathlib import Path

import imageio.v3 as iio
import numpy as np
import sapien
from PIL import Image, ImageDraw, ImageFont
from scipy.spatial.transform import Rotation

from dgl_assets.robots import DEFAULT_ROBOT, HAND_POSES, SIDES
from dgl_tasks.studio import light_scene

POSES = tuple(HAND_POSES)
JOINT_NAMES = DEFAULT_ROBOT.joint_names
STEPS_A_SECOND = 240
WIDTH, HEIGHT, LABEL = 320, 440, 34  # pixels of one picture and of the line under it


def main(
    path: Path = Path("hand_poses.png"), *, seconds: float = 2.0, samples: int = 2
) -> dict[str, float]:
    """Draw the poses side by side and measure them.

    Args:
        path: Picture to write, PNG.
        seconds: Time that the hands have for each pose [s].
        samples: Rendered pixels along each side of a pixel of the picture.

    Returns:
        Speed of the fastest joint at the end of each pose [rad/s], by name.
    """
    with tempfile.TemporaryDirectory() as folder:  # the renderer reads meshes when it first draws
        return _draw(path, Path(folder), seconds=seconds, samples=samples)


def _draw(path: Path, folder: Path, *, seconds: float, samples: int) -> dict[str, float]:
    sapien.render.set_camera_shader_dir("default")
    # of the whole process: environments that were made before have chosen bytes
    sapien.render.set_picture_format("Color", "r32g32b32a32sfloat")
    scene = sapien.Scene()
    scene.set_timestep(1 / STEPS_A_SECOND)
    light_scene(_Studio(scene))
    robot = _load_robot(scene, folder)
    joints = {joint.name: joint for joint in robot.active_joints}
    order = [list(joints).index(name) for name in JOINT_NAMES]
    camera = _hold_camera(scene, robot, samples)
    speeds, pictures = {}, []
    for pose in POSES:
        target = DEFAULT_ROBOT.compute_start(pose)
        for name, value in zip(JOINT_NAMES, target, strict=True):
            joints[name].set_drive_target(float(value))
        for _ in range(round(seconds * STEPS_A_SECOND)):
            scene.step()
        speeds[pose] = float(np.abs(robot.qvel).max())
        error = np.abs(robot.qpos[order] - target).max()
        print(f"{pose:<7} at most {speeds[pose]:.1e} rad/s, {error:.1e} rad off the pose")
        scene.update_render()
        camera.take_picture()
        colour = camera.get_picture("Color")[..., :3]
        pictures.append(_label((np.clip(colour, 0, 1) * 255).astype(np.uint8), pose))
    iio.imwrite(path, np.concatenate(pictures, axis=1))
    return speeds


def _load_robot(scene: sapien.Scene, folder: Path) -> sapien.physx.PhysxArticulation:
    """Put the robot at home, with the drives of the tasks."""
    loader = scene.create_urdf_loader()
    loader.fix_root_link = True
    robot = loader.load(str(DEFAULT_ROBOT.build_urdf(folder)))
    joints = {joint.name: joint for joint in robot.active_joints}
    for side in SIDES:
        for part, gains in (("arm", DEFAULT_ROBOT.arm.gains), ("hand", DEFAULT_ROBOT.hand.gains)):
            names = JOINT_NAMES[DEFAULT_ROBOT.joint_slice(side, part)]
            for name, gain in zip(names, gains, strict=True):
                joints[name].set_drive_properties(gain.stiffness, gain.damping, gain.force_limit)
                joints[name].set_armature(np.array([gain.armature], dtype=np.float32))
    for link in robot.links:
        link.disable_gravity = True
        for shape in link.collision_shapes:
            # the shapes of neighbours overlap: a side ignores itself, as in the tasks
            shape.set_collision_groups([1, 1, 1 << (27 if "left" in link.name else 28), 0])
    home = dict(zip(JOINT_NAMES, DEFAULT_ROBOT.compute_start(), strict=True))
    robot.set_qpos(np.array([home[name] for name in joints], dtype=np.float32))
    return robot


class _Studio:
    """A stand-in for the ManiSkill environment that `light_scene` needs."""

    def __init__(self, scene: sapien.Scene) -> None:
        self.sub_scenes = [scene]
        self.set_ambient_light = scene.set_ambient_light

    def add_directional_light(self, direction: list, colour: list, *, shadow: bool) -> None:
        self.sub_scenes[0].add_directional_light(direction, colour, shadow=shadow)


def _hold_camera(
    scene: sapien.Scene, robot: sapien.physx.PhysxArticulation, samples: int
) -> sapien.render.RenderCameraComponent:
    """Look at the right hand from the palm's side, its fingers upwards in the picture."""
    ee = next(link for link in robot.links if link.name == "right_ee").entity_pose
    T = ee.to_transformation_matrix()
    fingers, palm, thumb = T[:3, :3].T
    at = T[:3, 3] + 0.345 * fingers - 0.006 * thumb
    towards = -(palm + 0.55 * thumb - 0.15 * fingers)
    x = towards / np.linalg.norm(towards)
    z = fingers - (fingers @ x) * x
    z /= np.linalg.norm(z)
    rotation = Rotation.from_matrix(np.column_stack([x, np.cross(z, x), z]))
    # the studio's lamp hangs above, behind the palm that looks down
    scene.add_directional_light(list(x - 0.8 * thumb), [2.6, 2.55, 2.5], shadow=False)
    camera = scene.add_camera("hand", WIDTH * samples, HEIGHT * samples, 0.305, 0.05, 10.0)
    camera.entity.set_pose(sapien.Pose(at - 0.95 * x, np.roll(rotation.as_quat(), 1)))
    return camera


def _label(colour: np.ndarray, text: str) -> np.ndarray:
    picture = Image.fromarray(colour).resize((WIDTH, HEIGHT), Image.Resampling.LANCZOS)
    sheet = Image.new("RGB", (WIDTH, HEIGHT + LABEL), (247, 246, 244))
    sheet.paste(picture, (0, 0))
    ImageDraw.Draw(sheet).text(
        (WIDTH / 2, HEIGHT + LABEL / 2),
        text,
        fill=(40, 40, 40),
        font=ImageFont.load_default(20),
        anchor="mm",
    )
    return np.asarray(sheet)


if __name__ == "__main__":
    main(*(Path(argument) for argument in sys.argv[1:2]))
