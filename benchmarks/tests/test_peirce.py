"""Peirce's test of simulated strips gives the bending length of the fabric."""

import numpy as np
import pytest

from dgl_bench.physics.peirce import (
    compute_bending_length,
    compute_chord_angle,
    measure_bending_length,
)
from dgl_physics import FABRICS, ClothMaterial, SolverConfig


def test_the_elastica_has_peirces_angle():
    """41.5 degrees at twice the bending length; small deflections are L^3 / 8 c^3."""
    assert np.degrees(compute_chord_angle(2.0)) == pytest.approx(41.5, abs=0.05)
    assert compute_chord_angle(0.2) == pytest.approx(0.2**3 / 8, rel=1e-3)
    assert compute_bending_length(9.81e-6, 1.0) == pytest.approx(0.01)


@pytest.mark.parametrize("name", FABRICS)
def test_bending_length_of_each_fabric(name):
    """The bending length of each fabric at the default substeps, 4 rows in the overhang: 5 %."""
    result = measure_bending_length(FABRICS[name])
    assert result.error == pytest.approx(0.0, abs=0.05)


def test_bending_length_hardly_depends_on_the_mesh():
    """Default material, 12 substeps: 5 % with 3 to 6 rows; 6 rows are edges of 5 mm."""
    errors = [measure_bending_length(ClothMaterial(), rows=n).error for n in (3, 4, 6)]
    assert errors == pytest.approx([0.0] * 3, abs=0.05)


def test_bending_length_converges_with_substeps():
    """10 rows, edges of 3 mm, are beyond 12 substeps, and not beyond 48."""
    config = SolverConfig(substeps=48)
    coarse, fine = (
        measure_bending_length(ClothMaterial(), rows=10, config=c) for c in (None, config)
    )
    assert abs(fine.error) < 0.03
    assert abs(coarse.error) > 2 * abs(fine.error)


def test_bending_damping_moves_no_equilibrium():
    errors = [
        measure_bending_length(ClothMaterial(bending_damping=tau)).error for tau in (0.0, 0.1)
    ]
    assert errors[0] == pytest.approx(errors[1], abs=2e-3)
