"""Policies of ours, as a server answers for them: in chunks of a stage, or a stage as a whole."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol

from dgl_collect.policy_actor import Learned
from dgl_collect.skill import Skill

__all__ = ["SKILL", "STAGES", "Served", "ServedSkill", "ServedStages"]

STAGES = "dexgarmentlab.stages"
"""Protocol of policies that act in chunks in the stages of a task."""
SKILL = "dexgarmentlab.skill"
"""Protocol of skills that plan each stage of a task as a whole."""


class Served(Protocol):
    """Answers the messages of one client."""

    @property
    def metadata(self) -> Mapping[str, object]:
        """Map that the client is sent first."""
        ...

    def answer(self, message: Mapping[str, Any]) -> Mapping[str, object]:
        """Answer a message; whatever it raises is told to the client."""
        ...


@dataclass(frozen=True, kw_only=True)
class ServedStages:
    """Policies by name of the stage; see `client.RemoteStage`."""

    policies: Mapping[str, Learned]
    task: str
    """Environment id."""
    cloud: str
    """Kind of clouds that they see."""
    is_sent: bool
    """Hands begin at matched points."""

    @property
    def metadata(self) -> Mapping[str, object]:
        """Map that the client is sent first."""
        return {
            "protocol": STAGES,
            "task": self.task,
            "cloud": self.cloud,
            "is_sent": self.is_sent,
            "stages": {name: learned.chunks for name, learned in self.policies.items()},
        }

    def answer(self, message: Mapping[str, Any]) -> Mapping[str, object]:
        """Let the policy of a stage take the observations, and act."""
        if message.get("stage") not in self.policies:
            raise ValueError(f"a message must name one of the stages {sorted(self.policies)}")
        policy = self.policies[message["stage"]].policy
        if message.get("begins"):
            policy.reset(message["begins"]["constant"], seed=message["begins"]["seed"])
        for observation in message.get("past", ()):
            policy.observe(observation)
        return {"actions": policy.act(message["observation"])}


@dataclass(frozen=True, kw_only=True)
class ServedSkill:
    """A skill; see `client.RemoteSkill`."""

    skill: Skill
    task: str
    """Environment id."""

    @property
    def metadata(self) -> Mapping[str, object]:
        """Map that the client is sent first."""
        return {"protocol": SKILL, "task": self.task}

    def answer(self, message: Mapping[str, Any]) -> Mapping[str, object]:
        """Plan a stage."""
        if not {"stage", "starts", "anchors"} <= set(message):
            raise ValueError("a message must have a stage, starts and anchors")
        way = self.skill.plan(message["stage"], message["starts"], message["anchors"])
        hands = {
            str(side): {"points": hand.points, "turns": hand.turns, "poses": hand.poses}
            for side, hand in way.hands.items()
        }
        return {"hands": hands, "spread": way.spread}
