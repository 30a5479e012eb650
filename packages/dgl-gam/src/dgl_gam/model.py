"""The model as it is used: clouds in, corresponding points out."""

import copy
import difflib
import hashlib
import math
from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from dgl_gam._arrays import check_cloud
from dgl_gam._device import find_device
from dgl_gam._sampling import find_three_nearest, gather_points, interpolate
from dgl_gam._yaw import rotate_yaw
from dgl_gam.affordance import compute_affordance
from dgl_gam.augment import warp_clouds
from dgl_gam.checkpoint import Checkpoint, load_checkpoint, save_checkpoint
from dgl_gam.confidence import Calibration, compute_evidence
from dgl_gam.errors import WeightsNotFoundError
from dgl_gam.network import center_clouds

__all__ = ["Encoded", "GarmentAffordanceModel", "Matches", "check_garment_cloud"]

MIN_POINTS, MAX_POINTS = 16, 2**21
NETWORK_POINTS = 2048
"""Larger clouds are reduced to so many points, and the features interpolated back."""
WEIGHTS = Path(__file__).parent / "weights"
_TOGETHER = "garments"  # name of weights for several categories
_SOURCES_HELD = 8
_MIN_EXTENT_M = 1e-6
_MIN_WIDTH = 1e-3  # of a cloud, as a share of its length; below it the cloud is a line
_MAX_EXTENT_M = 1e6  # far above a garment in any unit; squares still fit into 32 bits
_RIVAL = 0.15  # share of the best yaw's probability from which the second best is tried too
_BETTER = 0.01  # by which the second best must explain the demonstrated garment better
_OPEN = 0.25  # share of the best yaw's probability from which on the shape does not tell the yaw
_PRIOR = 4.0
"""Weight of the source's yaw if the shape leaves the yaw open, in logits. The ends of a scarf and
the sides of a round hat look alike: the target is then taken to be turned as the source."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Encoded:
    """A cloud with its features."""

    features: Tensor
    """Unit vectors, shape (N, features)."""
    frame: Tensor
    """The cloud in the normalised frame, turned into the garment's own, shape (N, 3)."""
    yaw: float
    """Estimated yaw of the garment [rad]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Matches:
    """Matches of the source points on the target."""

    indices: np.ndarray
    """Index of the best point of the target's cloud, shape (K,), int64."""
    similarity: np.ndarray
    """Cosine similarity to every point of it, shape (K, M), float32."""
    confidence: np.ndarray
    """Probability that the true point is among the observed ones, shape (K,), float32."""
    evidence: np.ndarray
    """Evidence behind the confidence, shape (K, 4), see `dgl_gam.confidence`."""
    points: np.ndarray
    """The matched points [m], shape (K, 3), world frame."""


class GarmentAffordanceModel:
    """A trained matcher; implements `Matcher`."""

    def __init__(
        self,
        checkpoint: Checkpoint,
        *,
        category: str | None = None,
        device: str | torch.device = "cpu",
        source_views: int = 1,
    ) -> None:
        """Use a trained network.

        Args:
            checkpoint: The network.
            category: Category of the garments; needed where the network is for several.
            device: Where to compute.
            source_views: Views of the demonstrated cloud, bent a little, that its features are
                averaged over.

        Raises:
            ValueError: If the category is not one of the network's, an argument is out of range, or
                the device is not there.
        """
        config = checkpoint.network.config
        if category is None and len(config.categories) == 1:
            category = config.categories[0]
        if category not in config.categories and (category is not None or config.categories):
            raise ValueError(
                f"category must be one of {', '.join(config.categories) or 'none'}; got "
                f"{category!r}"
            )
        if source_views < 1:
            raise ValueError(f"source_views must be at least 1; got {source_views}")
        self.checkpoint = checkpoint
        """The network and what is known about it."""
        self.category = category
        """Category of the garments."""
        self.device = find_device(device)  # "cuda" becomes "cuda:0"
        """Device of the computation."""
        self.source_views = source_views
        """Number of bent views of the source over which its features are averaged."""
        network = checkpoint.network
        if next(network.parameters()).device != self.device:
            network = copy.deepcopy(network).to(self.device)  # others may use it where it is
        self._network = network.eval()
        self._sources: OrderedDict[bytes, Encoded] = OrderedDict()

    @classmethod
    def load(
        cls,
        what: str | Path,
        *,
        category: str | None = None,
        device: str | torch.device = "cpu",
        source_views: int = 1,
    ) -> "GarmentAffordanceModel":
        """Load trained weights.

        Args:
            what: A category, for the weights that come with this package, or a file ending in
                .safetensors.
            category: With a file for several categories: which one.
            device: Where to compute.
            source_views: As for the constructor.

        Raises:
            WeightsNotFoundError: If no weights for the category come with this package.
            GamCheckpointError: If a file is missing, damaged or foreign.
            ValueError: If the category is not one of the network's, or two different ones are
                named.
        """
        if isinstance(what, Path) or what.endswith(".safetensors"):
            path = Path(what)
        elif category not in (None, what):
            raise ValueError(f"category must be {what!r} or left out; got {category!r}")
        else:
            path, category = _find_weights(what), what
        checkpoint = load_checkpoint(path)
        return cls(checkpoint, category=category, device=device, source_views=source_views)

    def save(self, path: Path, *, is_half: bool = False) -> None:
        """Write the network to a file, as `load` reads it."""
        save_checkpoint(path, self.checkpoint, is_half=is_half)

    def with_calibration(self, calibration: Calibration) -> "GarmentAffordanceModel":
        """Return the same model with another calibration of the confidence."""
        return GarmentAffordanceModel(
            replace(self.checkpoint, calibration=calibration),
            category=self.category,
            device=self.device,
            source_views=self.source_views,
        )

    def match(
        self, source_cloud: np.ndarray, source_points: np.ndarray, target_cloud: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Find the corresponding points, as `Matcher.match` describes.

        Args:
            source_cloud: Visible points of the demonstrated garment [m], shape (N, 3), N >= 16,
                world frame.
            source_points: Points on it [m], shape (K, 3), world frame; the nearest of the cloud
                stands for each.
            target_cloud: Visible points of the observed garment [m], shape (M, 3), M >= 16, world
                frame.

        Returns:
            Indices into `target_cloud`, shape (K,), int64, and similarities, shape (K, M), float32.
        """
        matches = self.locate(source_cloud, source_points, target_cloud)
        return matches.indices, matches.similarity

    def affordance(
        self, source_cloud: np.ndarray, source_points: np.ndarray, target_cloud: np.ndarray
    ) -> np.ndarray:
        """Compute the channels that a policy sees: where each hand should grasp.

        Args:
            source_cloud: As for `match`.
            source_points: The grasp points of the left and the right hand, shape (2, 3); one, shape
                (1, 3), is repeated.
            target_cloud: As for `match`, shape (M, 3).

        Returns:
            Shape (M, 2), float32, in [0, 1].
        """
        points = check_cloud(source_points, "source_points")
        if len(points) > 2:
            raise ValueError(f"source_points must be one or two, left and right; got {len(points)}")
        channels = compute_affordance(self.match(source_cloud, points, target_cloud)[1])
        return channels if channels.shape[1] == 2 else np.repeat(channels, 2, axis=1)

    def locate(
        self,
        source_cloud: np.ndarray,
        source_points: np.ndarray,
        target_cloud: np.ndarray,
        *,
        yaw: float | None = None,
    ) -> Matches:
        """Find the corresponding points, and how sure they are.

        Args:
            source_cloud: As for `match`.
            source_points: As for `match`.
            target_cloud: As for `match`.
            yaw: How the target is turned about the vertical [rad], counter-clockwise from the frame
                in which garments lie flat, where that is known; found by the network when None.
        """
        yaws = None if yaw is None else [yaw]
        return self.locate_batch(source_cloud, source_points, [target_cloud], yaws=yaws)[0]

    def locate_batch(
        self,
        source_cloud: np.ndarray,
        source_points: np.ndarray,
        target_clouds: Sequence[np.ndarray],
        *,
        yaws: Sequence[float] | None = None,
    ) -> list[Matches]:
        """Match one source with many targets. Clouds of one size are computed together.

        Args:
            source_cloud: As for `match`.
            source_points: As for `match`.
            target_clouds: Clouds, each as for `match`.
            yaws: How they are turned, as for `locate`; found by the network when None.

        Raises:
            ValueError: If an argument has a wrong shape, or there is not one finite yaw for each
                cloud.
        """
        if yaws is not None and (len(yaws) != len(target_clouds) or not np.isfinite(yaws).all()):
            raise ValueError(
                f"yaws must be one finite angle for each of {len(target_clouds)} clouds; got {yaws}"
            )
        cloud = check_garment_cloud(source_cloud, "source_cloud")
        points = check_cloud(source_points, "source_points", min_points=0)
        targets = [
            check_garment_cloud(
                target, f"target_clouds[{number}]" if len(target_clouds) > 1 else "target_cloud"
            )
            for number, target in enumerate(target_clouds)
        ]
        index = (
            np.linalg.norm(cloud[None] - points[:, None], axis=2).argmin(axis=1)
            if len(points)
            else np.zeros(0, np.int64)
        )
        with torch.inference_mode():
            source = self._encode_source(cloud)
            return [
                self._compare(source, torch.from_numpy(index).to(self.device), target, encoded)
                for target, encoded in zip(
                    targets, self._encode(targets, source, yaws), strict=True
                )
            ]

    def encode(self, clouds: Sequence[np.ndarray]) -> list[Encoded]:
        """Compute the features of every point of clouds, each of shape (N, 3) [m], N >= 16."""
        checked = [
            check_garment_cloud(cloud, f"clouds[{number}]") for number, cloud in enumerate(clouds)
        ]
        with torch.inference_mode():
            return self._encode(checked, None)

    def _compare(
        self, source: Encoded, index: Tensor, target: np.ndarray, encoded: Encoded
    ) -> Matches:
        similarity = (source.features[index] @ encoded.features.T).clamp(-1.0, 1.0)
        best = similarity.argmax(dim=1)
        back = encoded.features[best] @ source.features.T
        evidence = compute_evidence(similarity, encoded.frame, back, source.frame, index)
        indices = best.cpu().numpy()
        return Matches(
            indices=indices,
            similarity=similarity.cpu().numpy(),
            confidence=self.checkpoint.calibration.apply(evidence),
            evidence=evidence,
            points=target[indices],
        )

    def _encode_source(self, cloud: np.ndarray) -> Encoded:
        """Compute and cache the source's features, averaged over bent views."""
        key = hashlib.sha256(np.ascontiguousarray(cloud).tobytes()).digest()
        if key in self._sources:
            self._sources.move_to_end(key)
            return self._sources[key]
        encoded = self._encode([cloud], None)[0]
        if self.source_views > 1:
            generator = torch.Generator().manual_seed(0)
            frame = encoded.frame.cpu().expand(self.source_views - 1, -1, -1)
            bent = warp_clouds(frame, generator, yaw=math.radians(15.0)).to(self.device)
            views = self.compute_features(center_clouds(bent)[0])
            total = encoded.features + views.sum(dim=0)
            encoded = replace(encoded, features=functional.normalize(total, dim=1))
        self._sources[key] = encoded
        if len(self._sources) > _SOURCES_HELD:
            self._sources.popitem(last=False)
        return encoded

    def _encode(
        self,
        clouds: Sequence[np.ndarray],
        source: Encoded | None,
        yaws: Sequence[float] | None = None,
    ) -> list[Encoded]:
        """Encode clouds; a source's features settle an ambiguous yaw."""
        groups: dict[int, list[int]] = {}
        for number, cloud in enumerate(clouds):
            groups.setdefault(len(cloud), []).append(number)
        results: dict[int, Encoded] = {}
        for numbers in groups.values():
            stacked = np.stack([clouds[number] for number in numbers])
            known = None if yaws is None else [yaws[number] for number in numbers]
            for number, encoded in zip(
                numbers, self._encode_equal(stacked, source, known), strict=True
            ):
                results[number] = encoded
        return [results[number] for number in range(len(clouds))]

    def _encode_equal(
        self, clouds: np.ndarray, source: Encoded | None, known: Sequence[float] | None = None
    ) -> list[Encoded]:
        # Centred in double precision: a garment far from the origin keeps its shape.
        local = clouds - clouds.mean(axis=1, keepdims=True)
        points = torch.from_numpy(local.astype(np.float32)).to(self.device)
        points = center_clouds(points)[0]
        if known is not None:
            frame = rotate_yaw(points, -torch.tensor(known, dtype=points.dtype, device=self.device))
            return [
                Encoded(features=f, frame=p, yaw=y)
                for f, p, y in zip(self.compute_features(frame), frame, known, strict=True)
            ]
        logits = self._network.yaw(_reduce(points))
        yaws, masses = self._network.yaw.find_peaks(logits, 2)
        if source is not None:
            is_open = masses[:, 1:] > _OPEN * masses[:, :1]
            step = 2 * math.pi / logits.shape[1]
            turn = torch.arange(logits.shape[1], device=self.device) * step - source.yaw
            nearest = logits + _PRIOR * turn.cos() * is_open
            yaws, masses = self._network.yaw.find_peaks(nearest, 2)
        frame = rotate_yaw(points, -yaws[:, 0])
        features = self.compute_features(frame)
        chosen = yaws[:, 0].tolist()
        if source is not None:
            rivals = torch.nonzero(masses[:, 1] > _RIVAL * masses[:, 0]).flatten()
            if len(rivals):
                other_frame = rotate_yaw(points[rivals], -yaws[rivals, 1])
                other = self.compute_features(other_frame)
                for row, rival in enumerate(rivals.tolist()):
                    if _score(source, other[row]) > _score(source, features[rival]) + _BETTER:
                        features[rival], frame[rival] = other[row], other_frame[row]
                        chosen[rival] = float(yaws[rival, 1])
        return [
            Encoded(features=f, frame=p, yaw=y)
            for f, p, y in zip(features, frame, chosen, strict=True)
        ]

    def compute_features(self, frame: Tensor) -> Tensor:
        """Compute features of normalised clouds of any size, in the garment frame.

        Args:
            frame: Clouds, shape (B, N, 3), on the model's device.

        Returns:
            Unit vectors, shape (B, N, features); gradients flow where they are recorded.
        """
        config = self._network.config
        category = None
        if len(config.categories) > 1 and self.category is not None:
            number = config.categories.index(self.category)
            category = torch.full((len(frame),), number, device=frame.device)
        if frame.shape[1] <= NETWORK_POINTS:
            return self._network(frame, category)
        kept = _reduce(frame)
        features = self._network(kept, category)
        parts = []
        for part in frame.split(8192, dim=1):  # bounds the table of distances
            indices, weights = find_three_nearest(part, kept)
            parts.append(functional.normalize(interpolate(features, indices, weights), dim=2))
        return torch.cat(parts, dim=1)


def check_garment_cloud(cloud: np.ndarray, name: str) -> np.ndarray:
    """Return a garment's cloud as float64 after checking it.

    Args:
        cloud: Points [m], shape (N, 3), any real dtype.
        name: Name of the argument for messages.

    Raises:
        ValueError: If N is not in [16, 2^21], a value is not finite, or the points are too close
            together, too far apart or on one line.
    """
    points = check_cloud(cloud, name, min_points=MIN_POINTS)
    if len(points) > MAX_POINTS:
        raise ValueError(f"{name} must have at most {MAX_POINTS} points; got {len(points)}")
    with np.errstate(over="ignore"):  # Of numbers near the largest; it is then infinite.
        extent = float(np.ptp(points, axis=0).max())
    if extent < _MIN_EXTENT_M:
        raise ValueError(f"{name} must have an extent above {_MIN_EXTENT_M} m; got {extent} m")
    if extent > _MAX_EXTENT_M:
        raise ValueError(f"{name} must have an extent below {_MAX_EXTENT_M:g} m; got {extent:g} m")
    length, width = np.sqrt(np.linalg.eigvalsh(np.cov(points.T)).clip(0.0)[:0:-1])
    if width < _MIN_WIDTH * length:
        raise ValueError(f"{name} must not lie on a straight line; its points do")
    return points


def _score(source: Encoded, features: Tensor) -> float:
    """Mean best similarity between parts of two clouds."""
    some = source.features[:: max(1, len(source.features) // 256)]
    others = features[:: max(1, len(features) // 512)]
    return float((some @ others.T).amax(dim=1).mean())


def _reduce(points: Tensor) -> Tensor:
    """Reduce clouds, shape (B, N, 3), to at most 2,048 points each.

    That order does not depend on the order in which the points came.
    """
    size = points.shape[1]
    if size <= NETWORK_POINTS:
        return points
    order = np.stack([np.lexsort(cloud.T) for cloud in points.cpu().numpy()])
    # A seeded shuffle of the sorted places: a stride would follow the garment's columns.
    places = np.random.default_rng(0).permutation(size)[:NETWORK_POINTS]
    return gather_points(points, torch.from_numpy(order[:, places]).to(points.device))


def _find_weights(category: str) -> Path:
    """Find the weights of a category in this package."""
    own = WEIGHTS / f"{category}.safetensors"
    if own.is_file():
        return own
    known = sorted({path.stem for path in WEIGHTS.glob("*.safetensors")} - {_TOGETHER})
    together = WEIGHTS / f"{_TOGETHER}.safetensors"
    if together.is_file():
        categories = load_checkpoint(together).network.config.categories
        if category in categories:
            return together
        known = sorted({*known, *categories})
    near = difflib.get_close_matches(category, known, n=1)
    hint = f"; the nearest is {near[0]!r}" if near else ""
    raise WeightsNotFoundError(
        f"no trained weights for {category!r} come with dgl_gam; there are: "
        f"{', '.join(known) or 'none'}{hint}. "
        "Weights of your own, from `dgl train gam`, are loaded by their path, ending in "
        ".safetensors"
    )
