"""Fingers with drives close on cloth: it stops them, and lets go of them."""

import numpy as np
import pytest

sapien = pytest.importorskip("sapien")
from sapien import physx  # noqa: E402

from dgl_physics import ClothMaterial, SolverConfig  # noqa: E402
from dgl_physics.sapien_bridge import SapienCloth  # noqa: E402

RADIUS = 0.009
MATERIAL = ClothMaterial()
LOOSE = (
    2 * MATERIAL.rest_offset + MATERIAL.thickness
)  # between fingers that just touch two layers [m]
OVERLAP = 0.022  # of the fingers where their drives want them, [m]
UP = [np.sqrt(0.5), 0, -np.sqrt(0.5), 0]  # a joint's axis, x, becomes z


class Pinch:
    """Two capsules on prismatic joints along z, one above and one below of layers of cloth."""

    def __init__(self, sheet, layers, *, stiffness=100.0, damping=8.0):
        scene = sapien.Scene([physx.PhysxCpuSystem()])
        scene.set_timestep(1 / 120)
        self.scene, self.damping = scene, damping
        self.fingers = [self._add_finger(stiffness, name) for name in ("upper", "lower")]
        self.cloth = SapienCloth([scene], config=SolverConfig(gravity=(0.0, 0.0, 0.0)))
        for k in range(layers):
            height = (k - (layers - 1) / 2) * MATERIAL.thickness
            vertices, faces = sheet(0.15, 0.15, 0.0125, height=height)
            self.cloth.add_garment(vertices - [*vertices.mean(axis=0)[:2], 0.0], faces)
        if not layers:
            self.cloth.add_garment(*sheet(0.1, 0.1, 0.0125, height=1.0))
        for finger, sign in zip(self.fingers, (1, -1), strict=True):
            finger.set_qpos([sign * 0.05])
        self.cloth.build()
        names = [body.name for body in self.cloth.bodies[0]]
        self.bodies = [names.index("upper"), names.index("lower")]

    def _add_finger(self, stiffness, name):
        builder = self.scene.create_articulation_builder()
        base = builder.create_link_builder()
        base.set_name(f"{name} base")
        tip = builder.create_link_builder(base)
        tip.set_name(name)
        along = sapien.Pose([0, 0, 0], UP)
        tip.set_joint_properties("prismatic", [[-1, 1]], pose_in_parent=along, pose_in_child=along)
        tip.add_capsule_collision(
            sapien.Pose(), radius=RADIUS, half_length=0.012, material=physx.PhysxMaterial(1, 1, 0)
        )
        for link, mass in ((base, 1.0), (tip, 0.02)):
            link.set_mass_and_inertia(mass, sapien.Pose(), [mass * 1e-4] * 3)
        finger = builder.build(fix_root_link=True)
        finger.active_joints[0].set_drive_properties(stiffness, self.damping, 5.0)
        for link in finger.links:
            link.disable_gravity = True
        return finger

    def move(self, start, end, frames):
        """Drive the tips from +-start to +-end [m]; returns positions [m], forces [N], (T, 2)."""
        places, forces = [], []
        for k in range(frames):
            height = start + (end - start) * min((k + 1) / 40, 1.0)
            for finger, sign in zip(self.fingers, (1, -1), strict=True):
                finger.active_joints[0].set_drive_target(sign * height)
            for _ in range(2):
                self.cloth.apply_forces()
                self.scene.step()
            self.cloth.step()
            places.append([finger.qpos[0] for finger in self.fingers])
            forces.append(self.cloth.get_forces()[0, self.bodies, 2])
        return np.array(places), np.array(forces)


def compute_gaps(places):
    """Distances between the surfaces of the fingers [m], shape (T,)."""
    return places[:, 0] - places[:, 1] - 2 * RADIUS


CLOSED = RADIUS - OVERLAP / 2


def test_without_cloth_the_fingers_meet(sheet):
    places, forces = Pinch(sheet, 0).move(0.05, CLOSED, 90)
    assert abs(compute_gaps(places)[-1]) < 5e-4
    assert np.abs(forces).max() == 0.0


@pytest.mark.parametrize("layers", [2, 4])
def test_cloth_stops_closing_fingers(sheet, layers):
    """They stand still, well apart, where the cloth's force on each is that of its drive."""
    places, forces = Pinch(sheet, layers).move(0.05, CLOSED, 150)
    gaps = compute_gaps(places)
    assert gaps[-1] > 0.4 * LOOSE
    assert gaps[-60:].std() < 1e-4
    drives = 100.0 * (places[-60:].mean(axis=0) - [CLOSED, -CLOSED])
    assert forces[-60:].mean(axis=0) == pytest.approx(drives, rel=0.05)


def test_more_layers_stop_them_earlier(sheet):
    two, _ = Pinch(sheet, 2).move(0.05, CLOSED, 120)
    four, _ = Pinch(sheet, 4).move(0.05, CLOSED, 120)
    assert compute_gaps(four)[-1] > compute_gaps(two)[-1] + 0.005


def test_opening_fingers_release_the_cloth(sheet):
    pinch = Pinch(sheet, 2)
    pinch.move(0.05, CLOSED, 90)
    places, forces = pinch.move(CLOSED, 0.05, 90)
    assert compute_gaps(places)[-1] == pytest.approx(0.1 - 2 * RADIUS, abs=2e-3)
    assert np.abs(forces[-1]).max() < 0.02
