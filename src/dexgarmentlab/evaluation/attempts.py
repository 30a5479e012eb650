"""Episodes of an evaluation, made by the collection's workers."""

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np

from dexgarmentlab.evaluation.methods import MethodOptions, make_method
from dgl_assets import garment_ids
from dgl_collect.attempt import film_attempt
from dgl_collect.results import AttemptResult
from dgl_collect.setup import make_setup
from dgl_tasks import get_task

if TYPE_CHECKING:
    from dgl_assets.garments.catalogue import Split

__all__ = ["FACTORY", "GarmentChoice", "choose_split", "make_evaluation_runner"]

FACTORY = "dexgarmentlab.evaluation.attempts:make_evaluation_runner"
"""What the workers build, as `CollectConfig.attempt_factory` names it."""

GarmentChoice = Literal["both", "train", "test"]
"""Garments of the training split, of the testing split, or of both by turns."""


def choose_split(choice: GarmentChoice, attempt_index: int) -> "Split":
    """Choose the split of an episode's garment: with "both", even episodes train and odd ones test."""
    if choice == "both":
        return "train" if attempt_index % 2 == 0 else "test"
    return choice


def make_evaluation_runner(task: str, options: Mapping[str, object]) -> "EvaluationAttempts":
    """Build the episodes of an evaluation; see `dgl_collect.attempts.AttemptFactory`.

    Args:
        task: Environment id.
        options: The keyword arguments of `EvaluationAttempts`, those of `MethodOptions` under "method".
    """
    content = dict(options)
    method = content.pop("method", {})
    if not isinstance(method, Mapping):
        raise ValueError(f"option method must be an object; got {method!r}")
    return EvaluationAttempts(task, method=MethodOptions(**method), **content)  # pyright: ignore[reportArgumentType]


class EvaluationAttempts:
    """Runs one method in one environment, episode after episode; one depends on its seed and number alone."""

    def __init__(
        self,
        task: str,
        *,
        policy: str,
        method: MethodOptions,
        garments: GarmentChoice = "both",
        garment: str | None = None,
        friction: float = 1.0,
        matcher: str = "exact",
        look: str = "studio",
        render_backend: str | None = None,
    ) -> None:
        """Build the environment and the method.

        Args:
            task: Environment id.
            policy: Name of the method, or `module:factory`.
            method: What it is told.
            garments: Which garments.
            garment: The folder of an imported one to use in every episode instead.
            friction: A factor on the garment's friction and adhesion; at 0 nothing can be held.
            matcher: Finds the demonstrated points, for the methods that ask for them.
            look: "studio" or "random".
            render_backend: ManiSkill's; chosen by what is there when None.
        """
        if garments not in get_args(GarmentChoice):
            raise ValueError(
                f"garments must be one of {list(get_args(GarmentChoice))}; got {garments!r}"
            )
        declared = get_task(task)
        material = dataclasses.replace(
            declared.material,
            friction=friction * declared.material.friction,
            adhesion=friction * declared.material.adhesion,
        )
        self._setup = make_setup(
            dataclasses.replace(declared, material=material),
            matcher=matcher,
            look=look,
            render_backend=render_backend,
        )
        self._garments: GarmentChoice = garments
        self._garment = garment
        self._policy = make_method(policy, self._setup, method)

    def close(self) -> None:
        """Release the environment."""
        self._setup.env.close()

    def run(
        self, *, attempt_index: int, seed: int, out_dir: Path, episode_id: str
    ) -> AttemptResult:
        """Run one episode; see `dgl_collect.attempts.AttemptRunner`."""
        split = choose_split(self._garments, attempt_index)
        result, _ = film_attempt(
            self._setup,
            self._policy,
            index=attempt_index,
            seed=seed,
            garment=self._garment or draw_garment(self._setup.env.task.category, split, seed),
            out_dir=out_dir,
            episode_id=episode_id,
        )
        return dataclasses.replace(
            result,
            randomisation={
                **result.randomisation,
                "split": split if self._garment is None else "own",
            },
        )


def draw_garment(category: str, split: "Split", seed: int) -> str:
    """Draw the garment of an episode from a split of its category."""
    ids = garment_ids(category, split)
    return ids[int(np.random.default_rng([seed, 3]).integers(len(ids)))]
