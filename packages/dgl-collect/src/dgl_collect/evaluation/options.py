"""Options of an evaluation: those of a run, and which method acts."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from annotated_types import Ge

from dgl_collect.options import GarmentChoice, RunOptions

__all__ = ["EvaluationOptions"]


@dataclass(frozen=True, kw_only=True)
class EvaluationOptions(RunOptions):
    """Options of an evaluation."""

    policy: str
    """The method: nothing, lift-drop, expert; learned: primitive, blind, halo, sadp, gam-dp3, dp3,
    dp; or module:factory of your own."""
    garments: GarmentChoice = "both"
    """Garments of the training split, of the testing split, or of both by turns."""
    friction: Annotated[float, Ge(0)] = 1.0
    """A factor on the garment's friction and adhesion: at 0 no hand can hold it, and no method must
    succeed."""
    checkpoints: Path | None = None
    """Trained policies of a learned method: a folder with stage_1/policy.safetensors and so on; of
    primitive and blind, the folder of a training. Default of these: what comes with dgl-sadp."""
    chunks: Annotated[int, Ge(1)] | None = None
    """Predictions in each stage. Default: enough for the longest recording."""
    actions: Annotated[int, Ge(1)] = 600
    """Most actions of a policy of your own, each five control steps; 600 are 50 s."""
    device: Literal["cpu", "cuda"] = "cpu"
    """Device on which policies compute."""
