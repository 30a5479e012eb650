import dataclasses
import json
import math

import numpy as np
import pytest
import torch
from safetensors import safe_open
from safetensors.numpy import save_file

from dgl_files.tensors import seal
from dgl_gam import GamCheckpointError, GarmentAffordanceModel, Matcher, WeightsNotFoundError
from dgl_gam.checkpoint import Checkpoint, load_checkpoint, save_checkpoint
from dgl_gam.confidence import Calibration, compute_auroc, compute_evidence, fit_calibration
from dgl_gam.config import PRESETS
from dgl_gam.model import WEIGHTS, Encoded
from dgl_gam.network import GarmentNetwork


@pytest.fixture(scope="module")
def checkpoint():
    torch.manual_seed(0)
    config = dataclasses.replace(PRESETS["small"], categories=("Shirt",))
    network = GarmentNetwork(config)
    with torch.no_grad():
        network.yaw.last.weight *= 1e4  # as sure of the yaw as a trained one
    return Checkpoint(network=network, card={"seed": 0})


@pytest.fixture(scope="module")
def model(checkpoint):
    return GarmentAffordanceModel(checkpoint)


@pytest.fixture
def cloud(make_flat_shirt, rng):
    make, see = make_flat_shirt
    shirt = make(rng)
    return see(shirt["vertices"], shirt["faces"], rng, 600)[0].astype(np.float64)


def test_it_is_a_matcher(model):
    assert isinstance(model, Matcher)


def test_a_garment_matches_itself_wherever_it_lies(model, cloud):
    turned = cloud[:, [1, 0, 2]] * [-1, 1, 1] * 1.7 + [30.0, -20.0, 0.5]
    indices, similarity = model.match(cloud, cloud[:50], turned)
    assert indices.dtype == np.int64
    assert similarity.shape == (50, 600)
    assert similarity.dtype == np.float32
    distance = np.linalg.norm(turned[indices] - turned[:50], axis=1)
    assert np.quantile(distance, 0.9) < 0.1  # also with random weights
    np.testing.assert_array_equal(indices, similarity.argmax(axis=1))


@pytest.mark.parametrize("lead", [0.0, 8.0])
@pytest.mark.parametrize("demonstrated", [0, 30])
def test_where_the_shape_does_not_tell_the_yaw_is_that_of_the_demonstration(
    model, cloud, monkeypatch, lead, demonstrated
):
    logits = torch.full((1, 60), -9.0)
    logits[:, 0], logits[:, 30] = 2.0, 2.0 + lead  # two opposite angles, the second the likelier
    monkeypatch.setattr(model._network.yaw, "forward", lambda points: logits)
    monkeypatch.setattr("dgl_gam.model._score", lambda source, features: 0.5)  # as good on either
    source = Encoded(
        features=torch.zeros(1, 128), frame=torch.zeros(1, 3), yaw=demonstrated * 2 * math.pi / 60
    )
    found = model._encode([cloud], source)[0].yaw
    wanted = math.pi if lead else source.yaw
    assert math.cos(found - wanted) > 0.99


def test_a_yaw_that_is_known_is_not_sought(model, cloud, monkeypatch):
    cos, sin = math.cos(2.0), math.sin(2.0)
    turned = cloud @ np.array([[cos, sin, 0], [-sin, cos, 0], [0, 0, 1]])
    expected = model.encode([cloud])[0]
    monkeypatch.setattr(model._network.yaw, "forward", None)  # would fail if it was asked
    source = dataclasses.replace(expected, yaw=0.0)
    monkeypatch.setattr(model, "_encode_source", lambda points: source)
    found = model.locate(cloud, cloud[:5], turned, yaw=2.0 + expected.yaw)
    similarity = (expected.features[:5] @ expected.features.T).numpy()
    np.testing.assert_allclose(found.similarity, similarity, atol=1e-3)
    with pytest.raises(ValueError, match="one finite angle for each of 1 clouds; got"):
        model.locate(cloud, cloud[:5], turned, yaw=math.nan)


def test_the_order_of_the_target_does_not_matter(model, cloud, rng):
    order = rng.permutation(len(cloud))
    first = model.match(cloud, cloud[:9], cloud)[1]
    np.testing.assert_allclose(
        model.match(cloud, cloud[:9], cloud[order])[1], first[:, order], atol=1e-4
    )


@pytest.mark.parametrize("size", [16, 17, 700, 2048, 2049, 9000])
def test_indices_refer_to_the_callers_points_at_any_size(model, make_flat_shirt, rng, size):
    make, see = make_flat_shirt
    shirt = make(rng)
    target = see(shirt["vertices"], shirt["faces"], rng, size)[0]
    source = see(shirt["vertices"], shirt["faces"], rng, 500)[0]
    matches = model.locate(source, source[:4], target)
    assert matches.similarity.shape == (4, size)
    assert matches.indices.max() < size
    np.testing.assert_array_equal(matches.points, target.astype(np.float64)[matches.indices])
    assert ((matches.confidence >= 0) & (matches.confidence <= 1)).all()


def test_large_clouds_are_reduced_independently_of_their_order(model, make_flat_shirt, rng):
    make, see = make_flat_shirt
    shirt = make(rng)
    large = see(shirt["vertices"], shirt["faces"], rng, 5000)[0]
    order = rng.permutation(5000)
    first = model.match(large[:100], large[:3], large)[1]
    second = model.match(large[:100], large[:3], large[order])[1]
    # Another choice of points changes every similarity; rounding changes the neighbours of a few.
    assert np.abs(second - first[:, order]).mean() < 1e-4


def test_many_targets_give_what_each_gives_alone(model, cloud):
    targets = [cloud, cloud[:300] + 1, cloud * 2, cloud[100:]]
    together = model.locate_batch(cloud, cloud[:5], targets)
    for target, matches in zip(targets, together, strict=True):
        alone = model.locate(cloud, cloud[:5], target)
        np.testing.assert_allclose(matches.similarity, alone.similarity, atol=1e-4)
        np.testing.assert_allclose(matches.confidence, alone.confidence, atol=1e-3)


def test_no_source_points_give_no_matches(model, cloud):
    indices, similarity = model.match(cloud, np.zeros((0, 3)), cloud)
    assert indices.shape == (0,)
    assert similarity.shape == (0, 600)


def test_affordance_has_a_channel_for_each_hand(model, cloud):
    two = model.affordance(cloud, cloud[[3, 9]], cloud)
    assert two.shape == (600, 2)
    assert two.min() >= 0
    assert two.max() <= 1
    np.testing.assert_array_equal(two.argmax(axis=0), model.match(cloud, cloud[[3, 9]], cloud)[0])
    one = model.affordance(cloud, cloud[[3]], cloud)
    np.testing.assert_array_equal(one[:, 0], one[:, 1])
    np.testing.assert_allclose(one[:, 0], two[:, 0], atol=1e-5)
    with pytest.raises(ValueError, match="one or two, left and right; got 3"):
        model.affordance(cloud, cloud[:3], cloud)


def test_averaging_over_views_is_repeatable(checkpoint, cloud):
    results = [
        GarmentAffordanceModel(checkpoint, source_views=3).match(cloud, cloud[:5], cloud)[1]
        for _ in range(2)
    ]
    np.testing.assert_array_equal(*results)
    alone = GarmentAffordanceModel(checkpoint).match(cloud, cloud[:5], cloud)[1]
    assert not np.allclose(alone, results[0], atol=1e-4)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda c: c[:15], r"target_cloud must have at least 16 point\(s\); got 15"),
        (lambda c: c[:, :2], r"target_cloud must have shape \(N, 3\); got \(600, 2\)"),
        (lambda c: np.where(c == c[5, 0], np.nan, c), "target_cloud must be finite"),
        (np.zeros_like, "extent above"),
        (lambda c: c[:, :1] * [[0.3, 0.5, 0.1]], "target_cloud must not lie on a straight line"),
        (
            lambda c: np.broadcast_to(c[:1], (2**21 + 1, 3)),
            "target_cloud must have at most 2097152",
        ),
        (lambda c: c * 1e30, "extent below 1e[+]06 m; got"),
        (lambda c: c + 1j, "target_cloud must be real numbers .*: they are complex"),
        (lambda c: c.astype(str).astype(object) + "?", "target_cloud must be real numbers"),
        (lambda c: [[0, 0, 0], [0, 0]], "target_cloud must be real numbers"),
    ],
)
def test_bad_clouds_are_refused_in_one_line(model, cloud, change, message):
    with pytest.raises(ValueError, match=message) as caught:
        model.match(cloud, cloud[:2], change(cloud))
    assert "\n" not in str(caught.value)
    if "target_cloud" in message:
        with pytest.raises(ValueError, match=message.replace("target_cloud", "source_cloud")):
            model.match(change(cloud), cloud[:2], cloud)


def test_unknown_categories_and_missing_weights_are_refused(checkpoint, tmp_path):
    with pytest.raises(ValueError, match="category must be one of Shirt; got 'Hat'"):
        GarmentAffordanceModel(checkpoint, category="Hat")
    with pytest.raises(
        WeightsNotFoundError, match=r"for 'Flying_Carpet' .* Glove, Scarf, .*Trousers\."
    ):
        GarmentAffordanceModel.load("Flying_Carpet")
    with pytest.raises(WeightsNotFoundError, match="the nearest is 'Trousers'"):
        GarmentAffordanceModel.load("trousers")
    with pytest.raises(ValueError, match="category must be 'Scarf' or left out; got 'Glove'"):
        GarmentAffordanceModel.load("Scarf", category="Glove")
    with pytest.raises(GamCheckpointError, match=r"none\.safetensors cannot be read"):
        GarmentAffordanceModel.load(tmp_path / "none.safetensors")
    with pytest.raises(ValueError, match="source_views must be at least 1"):
        GarmentAffordanceModel(checkpoint, source_views=0)


@pytest.mark.parametrize("device", ["gpu", "cuda:9", "meta:x"])
def test_a_device_that_is_not_there_is_refused_in_one_line(checkpoint, device):
    with pytest.raises(ValueError, match=f"device must be one .* got '{device}'") as caught:
        GarmentAffordanceModel(checkpoint, device=device)
    assert "\n" not in str(caught.value)


@pytest.mark.gpu
@pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device")
def test_features_on_cuda_are_those_of_the_cpu(checkpoint, cloud):
    models = [GarmentAffordanceModel(checkpoint, device=device) for device in ("cpu", "cuda:0")]
    similarity = [model.match(cloud, cloud[:9], cloud + 1.0)[1] for model in models]
    np.testing.assert_allclose(*similarity, atol=5e-3)


def test_weights_that_come_along_are_loaded_by_category(checkpoint, tmp_path, monkeypatch):
    monkeypatch.setattr("dgl_gam.model.WEIGHTS", tmp_path)
    save_checkpoint(tmp_path / "Shirt.safetensors", checkpoint)
    assert GarmentAffordanceModel.load("Shirt").category == "Shirt"
    with pytest.raises(WeightsNotFoundError, match="for 'Hat' come with dgl_gam; there are: Shirt"):
        GarmentAffordanceModel.load("Hat")
    several = dataclasses.replace(PRESETS["small"], categories=("Hat", "Scarf"))
    save_checkpoint(tmp_path / "garments.safetensors", Checkpoint(network=GarmentNetwork(several)))
    assert GarmentAffordanceModel.load("Scarf").category == "Scarf"
    with pytest.raises(ValueError, match="category must be one of Hat, Scarf; got None"):
        GarmentAffordanceModel.load(tmp_path / "garments.safetensors")


def test_the_category_matters_where_a_network_is_for_several(cloud):
    torch.manual_seed(0)
    several = dataclasses.replace(PRESETS["small"], categories=("Hat", "Scarf"))
    shared = Checkpoint(network=GarmentNetwork(several))
    results = [
        GarmentAffordanceModel(shared, category=name).match(cloud, cloud[:5], cloud)[1]
        for name in several.categories
    ]
    assert not np.allclose(*results, atol=1e-3)


def test_what_is_saved_is_loaded(model, cloud, tmp_path):
    calibration = Calibration(weights=(1.0, 2.0, 3.0, 4.0), bias=0.5, samples=7)
    model.with_calibration(calibration).save(tmp_path / "deep" / "a.safetensors")
    loaded = GarmentAffordanceModel.load(str(tmp_path / "deep" / "a.safetensors"))
    assert loaded.checkpoint.calibration == calibration
    assert loaded.checkpoint.card == {"seed": 0}
    assert loaded.category == "Shirt"
    np.testing.assert_array_equal(
        loaded.match(cloud, cloud[:5], cloud)[1], model.match(cloud, cloud[:5], cloud)[1]
    )
    assert [p.name for p in (tmp_path / "deep").iterdir()] == ["a.safetensors"]


def test_half_precision_halves_the_file_and_hardly_changes_the_features(model, cloud, tmp_path):
    model.save(tmp_path / "full.safetensors")
    model.save(tmp_path / "half.safetensors", is_half=True)
    sizes = [(tmp_path / f"{name}.safetensors").stat().st_size for name in ("full", "half")]
    assert sizes[1] < 0.52 * sizes[0]
    assert sizes[1] < 1.4e6
    half = GarmentAffordanceModel.load(tmp_path / "half.safetensors")
    np.testing.assert_allclose(
        half.match(cloud, cloud[:5], cloud)[1], model.match(cloud, cloud[:5], cloud)[1], atol=0.02
    )


def test_damaged_and_foreign_checkpoints_are_refused_by_name(checkpoint, tmp_path):
    path = tmp_path / "a.safetensors"
    save_checkpoint(path, checkpoint)
    whole = path.read_bytes()
    tensors = {name: t.numpy() for name, t in checkpoint.network.state_dict().items()}
    with safe_open(path, framework="np") as file:
        metadata = dict(file.metadata())

    def write(arrays=tensors, **changes):
        """Write the file with checksums that fit, as another program might."""
        save_file(arrays, path, metadata=seal({**metadata, **changes}, arrays))

    def refuse(message):
        with pytest.raises(GamCheckpointError, match=message) as caught:
            load_checkpoint(path)
        assert "a.safetensors" in str(caught.value)
        assert "\n" not in str(caught.value)

    for content in (whole[:1000], whole[:-100], b"", b"garbage" * 100):
        path.write_bytes(content)
        refuse("cannot be read as a network")
    write(format="another")
    refuse("is no network of dgl_gam")
    write(version="9")
    refuse("version must be '2'; got '9'")
    write(network="{}")
    refuse("metadata are damaged: levels: field required")
    config = json.loads(metadata["network"])
    for key, value, message in (
        ("features", "many", "features should be a valid integer; got 'many'"),
        ("features", -3, r"features should be greater than or equal to 1; got -3"),
        ("attention_heads", 0, r"attention_heads should be greater than or equal to 1; got 0"),
        (
            "attention_blocks",
            10**9,
            r"attention_blocks should be less than or equal to 64; got 1000000000",
        ),
        ("head_width", 10**9, r"head_width should be less than or equal to 8192"),
    ):
        write(network=json.dumps({**config, key: value}))
        refuse(f"metadata are damaged: {message}")
    write(network=json.dumps({**config, "head_width": 8192}))  # Compared, before it is allocated.
    refuse("do not fit its configuration")
    for card, message in (
        ("[1]", "a card must be an object"),
        ("[" * 100_000, "recursion limit exceeded"),
        ('{"steps_done": 1e999}', "a number must be finite"),
        ('{"steps_done": "many"}', r"card\.steps_done should be a valid integer; got 'many'"),
        ('{"train": []}', r"card\.train should be a valid dictionary"),
        ('{"earlier": [{"parts": []}]}', r"card\.parts should be a valid string"),
        ('{"versions": {"torch": 2}}', r"card\.versions\.torch should be a valid string"),
    ):
        write(card=card)
        refuse(f"metadata are damaged: {message}")
    for calibration, message in (
        ("{}", "a calibration must have weights"),
        ('{"weights": [1, 2], "bias": 0, "samples": 0}', "weights must be 4 numbers"),
        ('{"weights": [1, 2, 3, "4"], "bias": 0, "samples": 0}', "should be a valid number"),
        ('{"weights": [1, 2, 3, 4], "bias": NaN, "samples": 0}', "a number must be finite"),
        (
            '{"weights": [1, 2, 3, 4], "bias": 0, "samples": 1.5}',
            "samples should be a valid integer",
        ),
    ):
        write(calibration=calibration)
        refuse(message)
    write(dict(list(tensors.items())[1:]))
    refuse("do not fit its configuration")
    name = "position.weight"
    write({**tensors, name: tensors[name][:5].copy()})
    refuse("do not fit its configuration: position.weight")
    write({**tensors, name: tensors[name] * float("nan")})
    refuse("must be finite; not so: position.weight")
    for dtype in (np.int64, np.float64, np.bool_, np.complex64, np.uint8):
        write({**tensors, name: tensors[name].astype(dtype)})
        refuse("position.weight must be of type F16 or F32; got")


def test_flipped_bits_of_weights_are_found(checkpoint, tmp_path):
    path = tmp_path / "a.safetensors"
    save_checkpoint(path, checkpoint)
    whole = path.read_bytes()
    header = 8 + int.from_bytes(whole[:8], "little")
    for share in (0.0, 0.3, 0.9):
        content = bytearray(whole)
        content[header + int(share * (len(content) - header))] ^= 1
        path.write_bytes(content)
        with pytest.raises(GamCheckpointError, match=r"a\.safetensors is damaged: its checksum"):
            load_checkpoint(path)
    path.write_bytes(whole.replace(b'bias\\": -3.0', b'bias\\": -4.0'))
    assert path.read_bytes() != whole
    with pytest.raises(GamCheckpointError, match="metadata are damaged: their checksum"):
        load_checkpoint(path)


def test_weights_of_float8_are_refused(checkpoint, tmp_path):
    from safetensors.torch import save_file as save_tensors

    path = tmp_path / "a.safetensors"
    save_checkpoint(path, checkpoint)
    with safe_open(path, framework="np") as file:
        metadata = file.metadata()
    state = checkpoint.network.state_dict()
    save_tensors({name: t.to(torch.float8_e4m3fn) for name, t in state.items()}, path, metadata)
    with pytest.raises(GamCheckpointError, match="must be of type F16 or F32; got F8_E4M3"):
        load_checkpoint(path)


def test_weights_of_the_first_version_are_read(checkpoint, tmp_path):
    path = tmp_path / "a.safetensors"
    save_checkpoint(path, checkpoint)
    with safe_open(path, framework="np") as file:
        metadata = {k: v for k, v in file.metadata().items() if "checksum" not in k}
    state = {name: t.numpy() for name, t in checkpoint.network.state_dict().items()}
    save_file(state, path, metadata={**metadata, "version": "1"})
    assert load_checkpoint(path).network.config == checkpoint.network.config


def test_weights_that_come_along_have_checksums():
    for path in WEIGHTS.glob("*.safetensors"):
        with safe_open(path, framework="np") as file:
            assert file.metadata()["version"] == "2"


def test_evidence_tells_a_sharp_match_from_a_flat_one():
    frame = torch.linspace(0, 1, 50)[:, None] * torch.tensor([1.0, 0.0, 0.0])
    sharp = 1 - (frame[:, 0] - 0.3).abs() * 4
    flat = 0.5 - (frame[:, 0] - 0.3).abs() * 0.01
    similarity = torch.stack([sharp.clamp(-1, 1), flat])
    back = torch.stack([sharp.clamp(-1, 1), -frame[:, 0]])
    index = torch.tensor([15, 15])
    found = compute_evidence(similarity, frame, back, frame, index)
    assert found.shape == (2, 4)
    assert found[0, 0] > found[1, 0]
    assert found[0, 1] > 0.5 > found[1, 1]
    assert found[0, 2] < found[1, 2]
    assert found[0, 3] < 0.02 < found[1, 3]


def test_calibration_finds_the_weights_that_made_the_labels(rng):
    evidence = rng.normal(size=(4000, 4)) * [1, 0.1, 3, 1] + [0, 5, 0, 0]
    score = evidence @ [2.0, 10.0, -0.5, 0.0] - 49.0
    labels = rng.uniform(size=4000) < 1 / (1 + np.exp(-score))
    found = fit_calibration(evidence, labels)
    np.testing.assert_allclose(found.weights, [2.0, 10.0, -0.5, 0.0], rtol=0.15, atol=0.15)
    confidence = found.apply(evidence)
    for low in (0.1, 0.4, 0.7):
        chosen = (confidence > low) & (confidence < low + 0.2)
        assert labels[chosen].mean() == pytest.approx(confidence[chosen].mean(), abs=0.08)
    assert Calibration.from_json(found.to_json()) == found
    with pytest.raises(ValueError, match="both visible and hidden"):
        fit_calibration(evidence, np.ones(4000, bool))


def test_auroc_counts_ordered_pairs():
    rng = np.random.default_rng(0)
    scores, labels = rng.integers(0, 9, 60) / 9, rng.uniform(size=60) < 0.4
    pairs = [(a > b) + 0.5 * (a == b) for a in scores[labels] for b in scores[~labels]]
    assert compute_auroc(scores, labels) == pytest.approx(np.mean(pairs))
    assert np.isnan(compute_auroc(scores, np.ones(60, bool)))
