"""HALO: the Garment Affordance Model finds the grasp points, a diffusion policy does the rest."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from huggingface_hub import ModelCard, ModelHubMixin, hf_hub_download

from dexgarmentlab.learned_methods import check_card, make_actor
from dgl_collect.demonstration import load_demonstration
from dgl_collect.options import RunOptions
from dgl_collect.setup import make_setup
from dgl_sadp import DiffusionPolicy, find_policy, load_policy, read_card, save_policy
from dgl_sadp.card import format_card
from dgl_sadp.checkpoint import POLICY_FILE
from dgl_tasks import get_task

if TYPE_CHECKING:
    from dgl_tasks.env import GarmentEnv
    from dgl_tasks.policy import Method

__all__ = ["HALO"]


class HALO(ModelHubMixin):
    """A policy behind the Garment Affordance Model, for one task.

        halo = HALO.load("FoldTops-v1")
        method = halo.make_method(env)

    `save_pretrained`, `from_pretrained` and `push_to_hub` are those of `huggingface_hub`; a folder
    holds `policy.safetensors`, its weights in 16 bits, `config.json` and the model card.

    Source:
        DexGarmentLab, section on HALO.
    """

    def __init__(self, policy: DiffusionPolicy, card: Mapping[str, Any]) -> None:
        """Join a policy and how it was made; see `dgl_sadp.read_card`."""
        self.policy = policy
        self.card = dict(card)

    @classmethod
    def load(cls, task: str, *, device: str = "cpu") -> "HALO":
        """Load what comes with `dgl_sadp`.

        Args:
            task: Environment id, such as FoldTops-v1.
            device: "cpu" or "cuda".

        Raises:
            UnknownTaskError: If there is no such task.
            CheckpointError: If there is none; the message tells how to make one.
        """
        get_task(task)
        return cls.read(find_policy(task), device=device)

    @classmethod
    def read(cls, path: str | Path, *, device: str = "cpu") -> "HALO":
        """Read the folder of a training, or its file.

        Raises:
            CheckpointError: If the file is missing or damaged.
        """
        return cls(load_policy(path, device=device), read_card(path))

    def make_method(self, env: "GarmentEnv") -> "Method":
        """Make the method that acts in a whole episode of an environment of the policy's task.

        Raises:
            ValueError: If the policy was trained on another task, robot, start or cloud.
        """
        demonstration = load_demonstration(env.task)
        check_card(self.card, demonstration, robot=env.agent.model.name, cloud=env.cloud)
        setup = make_setup(env.task, RunOptions(matcher="gam"), env=env)
        return setup.make_runner(make_actor(self.policy, self.card, demonstration))

    def generate_model_card(self, *args: object, **kwargs: object) -> ModelCard:
        """Write the model card."""
        del args, kwargs
        return ModelCard(format_card(self.policy, self.card))

    def _save_pretrained(self, save_directory: Path) -> None:
        save_policy(save_directory / POLICY_FILE, self.policy, self.card, is_half=True)

    @classmethod
    def _from_pretrained(
        cls,
        *,
        model_id: str,
        revision: str | None,
        cache_dir: str | Path | None,
        force_download: bool,
        local_files_only: bool,
        token: str | bool | None,
        device: str = "cpu",
        **model_kwargs: object,
    ) -> "HALO":
        del model_kwargs  # the card, which the policy's file holds, too
        if Path(model_id).is_dir():
            return cls.read(model_id, device=device)
        found = hf_hub_download(
            repo_id=model_id,
            filename=POLICY_FILE,
            revision=revision,
            cache_dir=cache_dir,
            force_download=force_download,
            token=token,
            local_files_only=local_files_only,
        )
        return cls.read(found, device=device)
