"""Particles of a garment, and its surface among them."""

import numpy as np
import pytest

from dgl_assets import load_garment
from dgl_physics import ClothMaterial, ModelBuilder, SolidMaterial, State
from dgl_tasks.soft_body import add_soft_body


@pytest.fixture(scope="module")
def hat():
    return load_garment("Bowl_Hat/000000")


@pytest.fixture(scope="module")
def glove():
    return load_garment("Glove/000013")


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


def add(garment, vertices, *what):
    simulation = Simulation()
    add_soft_body(simulation, garment, vertices, *what)
    (added,) = simulation.added
    return added


def test_cloth_keeps_its_rest_shape_wherever_it_is_placed(top):
    material, moved = ClothMaterial(), top.vertices + np.array([0.0, 0.0, 1.0])
    kind, vertices, faces, how = add(top, moved, material)
    assert kind == "cloth"
    assert vertices is moved
    assert faces is top.faces
    assert how == {
        "rest": top.rest_vertices, "material": material, "stiffness": None, "shrinkage": None
    }  # fmt: skip


def test_a_shell_of_cloth_has_bands_of_other_stiffness_and_length(glove):
    stiff, short = {"back_cuff": 9.0, "palm_cuff": 9.0}, {"back_wrist": 0.5, "palm_wrist": 0.5}
    kind, _, _, how = add(glove, glove.vertices, ClothMaterial(), stiff, short)
    assert kind == "cloth"
    assert "thickness" not in how
    for name, factors in (("stiffness", stiff), ("shrinkage", short)):
        is_there = np.isin(glove.face_panels, [glove.panels.index(panel) for panel in factors])
        band = np.unique(glove.faces[is_there])
        np.testing.assert_array_equal(how[name][band], next(iter(factors.values())))
        np.testing.assert_array_equal(np.delete(how[name], band), 1.0)


def test_a_shell_has_its_wall_and_is_stiffer_where_it_is_said_to_be(hat):
    material = SolidMaterial(youngs_modulus=3e5)
    kind, _, _, how = add(hat, hat.vertices, material)
    assert kind == "solid"
    assert how == {"material": material, "thickness": hat.wall_thickness, "stiffness": None}
    *_, how = add(hat, hat.vertices, material, {"brim": 5.0})
    by_panel = {
        name: how["stiffness"][np.unique(hat.faces[hat.face_panels == k])]
        for k, name in enumerate(hat.panels)
    }
    assert set(by_panel) == {"crown", "brim"}
    # where the panels meet the stiffer one tells
    np.testing.assert_array_equal(by_panel["brim"], 5.0)
    assert set(by_panel["crown"]) == {1.0, 5.0}
    assert (by_panel["crown"] == 1.0).mean() > 0.5
    *_, how = add(hat, hat.vertices, material, {"brim": 0.2})
    assert set(how["stiffness"]) == {0.2, 1.0}


def test_the_vertices_of_a_shell_are_its_first_particles(hat):
    builder = ModelBuilder()
    add_soft_body(builder, hat, hat.vertices, SolidMaterial())
    particles = State(builder.build("cpu")).get_positions()[0]
    assert len(particles) > len(hat.vertices)
    np.testing.assert_allclose(particles[: len(hat.vertices)], hat.vertices, atol=1e-6)


def test_what_does_not_belong_together_is_refused(hat, top):
    with pytest.raises(ValueError, match="of Tops_LongSleeve must be a ClothMaterial; got a Solid"):
        add(top, top.vertices, SolidMaterial())
    with pytest.raises(ValueError, match="a solid does not shrink"):
        add(hat, hat.vertices, SolidMaterial(), {}, {"brim": 0.5})
    with pytest.raises(ValueError, match=r"panels \['brim', 'crown'\] of Bowl_Hat; got \['rim'\]"):
        add(hat, hat.vertices, SolidMaterial(), {"rim": 2.0, "brim": 3.0})
