"""Confidence of a match: the probability that the true point is visible."""

import json
from dataclasses import dataclass
from typing import Annotated

import numpy as np
import torch
from annotated_types import Interval
from torch import Tensor

from dgl_files.fields import STRICT, check_fields, decode_json, from_plain, show

__all__ = ["EVIDENCE", "Calibration", "compute_auroc", "compute_evidence", "fit_calibration"]

EVIDENCE = ("similarity", "margin", "spread", "return_distance")
"""Names of the evidence for a match, see `compute_evidence`."""
_TEMPERATURE = 0.07
_FAR = 0.2  # normalised units: matches farther away than this are other places


@dataclass(frozen=True, kw_only=True)
class Calibration:
    """Logistic regression from a match's evidence to its confidence."""

    __pydantic_config__ = STRICT

    weights: tuple[float, ...] = (6.0, 4.0, -4.0, -6.0)
    """Weight of each kind of evidence. The default states only their signs and rough sizes."""
    bias: float = -3.0
    """Added to the weighted evidence."""
    samples: Annotated[int, Interval(ge=0, le=2**60)] = 0
    """Matches used for the fit; 0 if not fitted: then only the order of confidences has a
    meaning."""

    def __post_init__(self) -> None:
        check_fields(self)
        if len(self.weights) != len(EVIDENCE):
            raise ValueError(f"weights must be {len(EVIDENCE)} numbers; got {self.weights}")

    def apply(self, evidence: np.ndarray) -> np.ndarray:
        """Map evidence, shape (K, 4), to probabilities, shape (K,), float32."""
        score = np.clip(evidence @ np.asarray(self.weights) + self.bias, -50, 50)
        return (1 / (1 + np.exp(-score))).astype(np.float32)

    def to_json(self) -> str:
        """Write as JSON."""
        return json.dumps(
            {"weights": list(self.weights), "bias": self.bias, "samples": self.samples}
        )

    @classmethod
    def from_json(cls, text: str) -> "Calibration":
        """Read what `to_json` wrote; a `ValueError` says what is wrong."""
        values = decode_json(text)
        if not isinstance(values, dict) or set(values) != {"weights", "bias", "samples"}:
            raise ValueError(
                f"a calibration must have weights, bias and samples; got {show(values)}"
            )
        return from_plain(cls, values)


def compute_evidence(
    similarity: Tensor, frame: Tensor, back: Tensor, source_frame: Tensor, source_index: Tensor
) -> np.ndarray:
    """Compute what speaks for and against each match.

    Args:
        similarity: Of each source point to the target's points, shape (K, M).
        frame: The target's points in the normalised frame, shape (M, 3).
        back: Similarity of each matched point to the points of the source, shape (K, N).
        source_frame: The source's points in the normalised frame, shape (N, 3).
        source_index: Which of these the source points are, shape (K,).

    Returns:
        Shape (K, 4), float64: the largest similarity; by how much it exceeds the largest one
        farther than 0.2 away; the mean distance from the match under the similarities' softmax; and
        how far from the source point the match leads back to. Distances in normalised units.
    """
    best, index = similarity.max(dim=1)
    away = torch.cdist(frame[index], frame)  # (K, M)
    other = similarity.masked_fill(away < _FAR, -1.0).amax(dim=1)
    spread = ((similarity / _TEMPERATURE).softmax(dim=1) * away).sum(dim=1)
    returned = source_frame[back.argmax(dim=1)]
    distance = (returned - source_frame[source_index]).norm(dim=1)
    return torch.stack([best, best - other, spread, distance], dim=1).double().cpu().numpy()


def fit_calibration(evidence: np.ndarray, is_visible: np.ndarray) -> Calibration:
    """Fit the confidence by Newton's method with a weak ridge.

    Args:
        evidence: Shape (n, 4).
        is_visible: Whether the true point was visible, shape (n,), bool.

    Raises:
        ValueError: If not both kinds occur, or a shape is wrong.
    """
    labels = np.asarray(is_visible, dtype=np.float64)
    if evidence.shape != (len(labels), len(EVIDENCE)):
        raise ValueError(f"evidence must have shape (n, {len(EVIDENCE)}); got {evidence.shape}")
    if not 0 < labels.mean() < 1:
        raise ValueError("is_visible must hold both visible and hidden points")
    mean, scale = evidence.mean(axis=0), evidence.std(axis=0) + 1e-9
    design = np.c_[(evidence - mean) / scale, np.ones(len(labels))]
    weights = np.zeros(design.shape[1])
    ridge = np.diag([1e-2] * len(EVIDENCE) + [1e-9]) * len(labels) ** 0.5
    for _ in range(30):
        share = 1 / (1 + np.exp(-np.clip(design @ weights, -30, 30)))
        gradient = design.T @ (share - labels) + ridge @ weights
        curvature = (design * (share * (1 - share) + 1e-9)[:, None]).T @ design + ridge
        step = np.linalg.solve(curvature, gradient)
        weights -= step
        if np.abs(step).max() < 1e-8:
            break
    slope = weights[:-1] / scale
    return Calibration(
        weights=tuple(slope.tolist()),
        bias=float(weights[-1] - slope @ mean),
        samples=len(labels),
    )


def compute_auroc(scores: np.ndarray, is_positive: np.ndarray) -> float:
    """Compute the area under the ROC curve; NaN without both labels.

    Args:
        scores: Shape (n,).
        is_positive: Shape (n,), bool.
    """
    positive = np.asarray(is_positive, dtype=bool)
    count = int(positive.sum())
    if count in (0, len(positive)):
        return float("nan")
    _, inverse, counts = np.unique(scores, return_inverse=True, return_counts=True)
    ranks = (np.cumsum(counts) - (counts - 1) / 2)[inverse]
    above = ranks[positive].sum() - count * (count + 1) / 2
    return float(above / (count * (len(positive) - count)))
