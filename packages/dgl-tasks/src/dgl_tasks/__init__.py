"""Bimanual dexterous garment tasks as ManiSkill environments.

Importing this package registers the environments with Gymnasium; the simulator is imported only
when one is made.
"""

from dgl_tasks.errors import TaskError as TaskError
from dgl_tasks.tasks import get_task as get_task
from dgl_tasks.tasks import load_task as load_task
from dgl_tasks.tasks import task_ids as task_ids

__all__ = ["TaskError", "get_task", "load_task", "task_ids"]
