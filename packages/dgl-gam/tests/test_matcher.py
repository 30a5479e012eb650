import importlib.util
from pathlib import Path

import numpy as np

import dgl_gam

EXAMPLE = Path(__file__).parent.parent / "examples" / "affordance_of_a_rule.py"


def load_example():
    spec = importlib.util.spec_from_file_location("affordance_of_a_rule", EXAMPLE)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_a_class_with_match_is_a_matcher_and_one_without_is_not():
    assert isinstance(load_example().NearestInNormalForm(), dgl_gam.Matcher)
    assert not isinstance(object(), dgl_gam.Matcher)


def test_the_rule_of_the_example_fulfils_the_contract():
    cloud = np.random.default_rng(0).uniform(-1, 1, (40, 3))
    indices, similarity = load_example().NearestInNormalForm().match(cloud, cloud[:5], cloud)
    assert indices.dtype == np.int64
    assert similarity.dtype == np.float32
    assert similarity.shape == (5, 40)
    np.testing.assert_array_equal(indices, np.arange(5))  # A garment matches itself.


def test_the_example_finds_the_corners_of_the_larger_towel():
    result = load_example().main()
    assert result["largest_error_m"] < 0.15  # 512 points on 0.96 m²: about 4 cm apart.
    assert result["affordance_at_matches"] > 0.999


def test_exports_resolve():
    assert all(hasattr(dgl_gam, name) for name in dgl_gam.__all__)
