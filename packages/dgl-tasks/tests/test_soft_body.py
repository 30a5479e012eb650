"""Particles of a garment, and its surface among them."""

import numpy as np
import pytest

from dgl_assets import load_garment
from dgl_physics import ClothMaterial, SolidMaterial
from dgl_tasks.soft_body import SoftBody


@pytest.fixture(scope="module")
def hat():
    return load_garment("Bowl_Hat/000000")


@pytest.fixture(scope="module")
def top():
    return load_garment("Tops_LongSleeve/000000", spacing=0.025)


class Simulation:
    """Notes what is added to it."""

    def __init__(self):
        self.added = []

    def add_solid(self, vertices, faces, **how):
        self.added.append(("solid", vertices, faces, how))

    def add_garment(self, vertices, faces, **how):
        self.added.append(("cloth", vertices, faces, how))


def add(body, vertices):
    simulation = Simulation()
    body.add_to(simulation, vertices)
    (added,) = simulation.added
    return added


def test_cloth_keeps_its_rest_shape_wherever_it_is_placed(top):
    material, moved = ClothMaterial(), top.vertices + np.array([0.0, 0.0, 1.0])
    kind, vertices, faces, how = add(SoftBody(top, material), moved)
    assert kind == "cloth"
    assert vertices is moved
    assert faces is top.faces
    assert how == {"rest": top.rest_vertices, "material": material}


def test_a_shell_has_its_wall_and_is_stiffer_where_it_is_said_to_be(hat):
    material = SolidMaterial(youngs_modulus=3e5)
    kind, _, _, how = add(SoftBody(hat, material), hat.vertices)
    assert kind == "solid"
    assert how == {"material": material, "thickness": hat.wall_thickness, "stiffness": None}
    *_, how = add(SoftBody(hat, material, {"brim": 5.0}), hat.vertices)
    by_panel = {
        name: how["stiffness"][np.unique(hat.faces[hat.face_panels == k])]
        for k, name in enumerate(hat.panels)
    }
    assert set(by_panel) == {"crown", "brim"}
    # where the panels meet the stiffer one tells
    np.testing.assert_array_equal(by_panel["brim"], 5.0)
    assert set(by_panel["crown"]) == {1.0, 5.0}
    assert (by_panel["crown"] == 1.0).mean() > 0.5
    *_, how = add(SoftBody(hat, material, {"brim": 0.2}), hat.vertices)
    assert set(how["stiffness"]) == {0.2, 1.0}


def test_the_surface_of_a_shell_is_its_outer_side(hat):
    outer, inner = hat.vertices, hat.vertices - [0, 0, hat.wall_thickness]
    body = SoftBody(hat, SolidMaterial())
    np.testing.assert_array_equal(body.get_surface(np.concatenate([outer, inner])), outer)


def test_what_does_not_belong_together_is_refused(hat, top):
    with pytest.raises(ValueError, match="of Bowl_Hat must be a SolidMaterial; got a ClothMat"):
        SoftBody(hat, ClothMaterial())
    with pytest.raises(ValueError, match="of Tops_LongSleeve must be a ClothMaterial; got a Solid"):
        SoftBody(top, SolidMaterial())
    with pytest.raises(ValueError, match=r"panels \['brim', 'crown'\] of Bowl_Hat; got \['rim'\]"):
        SoftBody(hat, SolidMaterial(), {"rim": 2.0, "brim": 3.0})
