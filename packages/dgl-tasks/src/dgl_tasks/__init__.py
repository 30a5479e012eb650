"""Bimanual dexterous garment tasks as ManiSkill environments.

Importing this package registers the environments with Gymnasium; the simulator is imported only
when one is made.
"""

import gymnasium
from gymnasium.envs.registration import WrapperSpec

from dgl_tasks.errors import TaskError as TaskError
from dgl_tasks.tasks import get_task as get_task
from dgl_tasks.tasks import task_ids as task_ids

for _id in task_ids():
    gymnasium.register(
        id=_id,
        entry_point="dgl_tasks.env:GarmentEnv",
        kwargs={"task": _id},
        disable_env_checker=True,  # it expects NumPy where ManiSkill gives torch
        additional_wrappers=(
            WrapperSpec("BatchedTimeLimit", "dgl_tasks.time_limit:BatchedTimeLimit", {}),
        ),
    )

__all__ = ["TaskError", "get_task", "task_ids"]
