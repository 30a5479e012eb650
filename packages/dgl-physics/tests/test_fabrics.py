"""Fabrics by name."""

import numpy as np
import pytest

from dgl_physics import FABRICS, ClothMaterial, ModelBuilder, get_fabric

NAMES = {"knit_cotton", "woven_cotton", "denim", "silk", "wool", "polyester"}


def test_the_six_fabrics_are_there():
    assert set(FABRICS) == NAMES
    for name in NAMES:
        assert get_fabric(name) is FABRICS[name]


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("denimm", r"got 'denimm'; did you mean 'denim'\?"),
        ("knit-cotton", r"did you mean 'knit_cotton'\?"),
        ("steel", r"name must be one of \['denim', .*'woven_cotton'\]; got 'steel'$"),
    ],
)
def test_unknown_names_list_the_valid_ones(name, message):
    with pytest.raises(ValueError, match=message):
        get_fabric(name)


def compute_bending_length(stiffness, area_density):
    """Peirce's bending length [m]."""
    return (stiffness / (area_density * 9.81)) ** (1 / 3)


def test_the_numbers_are_those_of_cloth():
    """Bending lengths of apparel fabrics are 1 to 3 cm, and denim is the stiffest and heaviest."""
    length = {k: compute_bending_length(m.bending_stiffness, m.area_density)
              for k, m in FABRICS.items()}  # fmt: skip
    assert all(0.01 < c < 0.03 for c in length.values())
    assert max(FABRICS, key=lambda k: FABRICS[k].bending_stiffness) == "denim"
    assert max(FABRICS, key=lambda k: FABRICS[k].area_density) == "denim"
    assert min(FABRICS, key=lambda k: FABRICS[k].bending_stiffness) == "silk"
    # silk is derived from the bending length of the polyester weave
    assert length["silk"] == pytest.approx(length["polyester"], rel=0.01)


def test_the_default_bends_as_knitted_cotton():
    length = [compute_bending_length(m.bending_stiffness, m.area_density)
              for m in (ClothMaterial(), get_fabric("knit_cotton"))]  # fmt: skip
    assert length[0] == pytest.approx(length[1], rel=0.02)


@pytest.mark.parametrize("name", sorted(NAMES))
def test_each_hangs_from_two_corners(run, sheet, name):
    """Two seconds of a sheet of each: it comes to hang, and no particle is thrown."""
    vertices, faces = sheet(0.2, 0.2, 0.0125)
    builder = ModelBuilder(1)
    top = np.flatnonzero(vertices[:, 1] > vertices[:, 1].max() - 1e-6)
    builder.add_garment(
        vertices, faces, rest=vertices[:, :2], pinned=(top[0], top[-1]), material=FABRICS[name]
    )
    r = run(builder).step(120)
    assert np.abs(r.v).max() < 3.0
    assert r.x[:, 2].min() < -0.14
