"""The stage runner: everything in a stage but its recorded steps."""

from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from dgl_collect.actors import Actor
from dgl_collect.belief import BelievedView
from dgl_collect.formula import Value, evaluate_formula, find_names
from dgl_collect.names import name_scene
from dgl_collect.point_finder import PointFinder
from dgl_collect.skill import Skill
from dgl_collect.stage_work import Hold, HoldLost, Reaction, StageWork
from dgl_collect.steps import Demonstration, Stage
from dgl_gam import Matcher, compute_affordance
from dgl_tasks.errors import PerceptionError, UnreachableError
from dgl_tasks.handling import Handling
from dgl_tasks.messages import BeginsAgain, Believes, Message, Part, StageBegins, StageEnds
from dgl_tasks.sensing import GARMENT_CAMERA, SENSOR_CAMERAS, Sensed
from dgl_tasks.success import SuccessRule, Verdict

TRIES = 3
"""Most tries of a stage in one round. A hand that comes up empty, or loses the garment, leads to a
retry."""

T = TypeVar("T")
PartOf = Generator[Message, Sensed, T]
"""A generator of messages that returns a value."""


@dataclass(frozen=True, kw_only=True)
class StageRunner:
    """Runs the stages of a demonstration; implements `dgl_tasks.policy.Method`.

    Retries rest on what the cameras see.
    """

    demonstration: Demonstration
    demo_cloud: np.ndarray
    """Visible points of the demonstration's garment lying flat [m], shape (N, 3)."""
    rule: SuccessRule
    """The task's success rule, applied to the belief."""
    get_matcher: Callable[[], Matcher]
    """Gives the matcher for the garment in its present state."""
    actor: Actor
    skill: Skill | None = None
    """Ways of the steps that follow recordings."""
    rounds: int | None = None
    """Most rounds; by default the number in the demonstration."""
    tries: int = TRIES
    """Most tries of a stage in one round."""

    def __post_init__(self) -> None:
        for name in ("rounds", "tries"):
            count = getattr(self, name)
            if count is not None and count < 1:
                raise ValueError(f"{name} must be at least 1; got {count}")

    def run(self, hands: Handling) -> Part:
        """Run all stages, and repeat them while the task is believed not to be done.

        Raises:
            TaskError: If a target is out of reach, or a camera sees no garment.
        """
        yield from _Course(self, hands).perform()


class _Course:
    """One run of a `StageRunner`."""

    def __init__(self, runner: StageRunner, hands: Handling) -> None:
        self.runner, self.hands = runner, hands
        self.stages = runner.demonstration.stages
        self.finder = PointFinder(runner.demonstration, runner.demo_cloud)
        self._carried_out: set[str] = set()
        self._skipped: set[str] = set()
        self._round = 1
        self._is_begun = True  # a stage of the round has begun
        self._is_held = True

    def perform(self) -> Part:
        yield from self._look()
        rounds = self.runner.rounds or self.runner.demonstration.rounds
        for self._round in range(1, rounds + 1):
            stages = self.stages
            if self._round > 1:
                stages = tuple(stage for stage in self.stages if stage.again)
                self._is_begun = False
                # with fewer stages, the first positions still say where the garment has to go
                if stages == self.stages:
                    yield from self._look()
            is_last = self._round == rounds
            if not (yield from self._go_through(stages, is_last=is_last)):
                return
            if (is_last or self._is_whole) and (yield from self._believe()).success:
                return

    @property
    def _is_whole(self) -> bool:
        """True if every stage has been carried out, in any round."""
        return self._carried_out.issuperset(stage.name for stage in self.stages)

    def _go_through(self, stages: Sequence[Stage], *, is_last: bool) -> PartOf[bool]:
        """Run the stages of a round; return False if another round would be the same.

        A stage out of reach is skipped if an earlier round has carried it out, or if rounds are
        left: other stages may bring the garment nearer.
        """
        refused: list[UnreachableError] = []
        skipped: set[str] = set()
        self._is_held = True
        for stage in stages:
            if stage.when is not None and not (yield from self._meets(stage, stage.when)):
                skipped.add(stage.name)
                continue
            if not self._is_begun:  # a round without stages does not count
                self._is_begun = True
                names = tuple(other.name for other in stages if other.name not in skipped)
                yield from self.hands.mark(BeginsAgain(what="round", stages=names))
            try:
                hold = yield from self._run_stage(stage)
            except UnreachableError as err:
                if (is_last or not stage.again) and stage.name not in self._carried_out:
                    raise
                refused.append(err)
                if not self.hands.is_parked:  # it failed on its way, and has touched the garment
                    yield from self._give_up(stage)
                    self._is_held = False
                continue
            self._is_held = hold == "all"
            if hold is not None:
                self._carried_out.add(stage.name)
        self._skipped = skipped
        if len(refused) < len(stages):
            return True
        if not self._is_whole:
            raise refused[0]
        return False  # everything is out of reach, and would be again

    def _meets(self, stage: Stage, condition: str) -> PartOf[bool]:
        named = find_names(condition)
        value = (yield from self._believe()).value if "value" in named else np.nan
        if "garment" in named:
            yield from self.hands.settle()
        sensed = yield from self.hands.look(*SENSOR_CAMERAS[: "garment" in named])
        cloud = sensed.see_garment() if "garment" in named else np.zeros((1, 3))
        names: dict[str, Value] = {
            **self.runner.demonstration.values,
            **name_scene(cloud, sensed.frames, self.finder.points),
            "round": self._round,
            "held": float(self._is_held),
            "skipped": float(stage.name in self._skipped),
            "value": value,
        }
        return bool(evaluate_formula(condition, names))

    def _believe(self) -> PartOf[Verdict]:
        """Settle, and apply the rule to the belief."""
        yield from self.hands.settle()
        sensed = yield from self.hands.look(*SENSOR_CAMERAS)
        view = BelievedView(sensed, landmarks=self.finder.points)
        # Pyright takes no cached property for a property of a protocol.
        verdict = self.runner.rule(view)  # pyright: ignore[reportArgumentType]
        yield from self.hands.mark(Believes(values={"value": verdict.value}))
        return verdict

    def _look(self) -> Part:
        sensed = yield from self.hands.look(GARMENT_CAMERA)
        self.finder.look(sensed.see_garment(), self.runner.get_matcher())

    # One stage -------------------------------------------------------------------------------

    def _run_stage(self, stage: Stage) -> PartOf[Hold | None]:
        """Run a stage; return which hands held the garment to the end, None if none did."""
        if stage.on_loss == "lay down":
            try:
                return (yield from self._try(stage, 1, "lay down"))
            except HoldLost:
                yield from self._give_up(stage)
                return None
        tries = self.runner.tries
        for number in range(1, tries + 1):
            try:
                return (
                    yield from self._try(stage, number, "give up" if number < tries else "ignore")
                )
            except HoldLost:
                yield from self._give_up(stage)
                yield from self.hands.mark(BeginsAgain(what="try", stages=(stage.name,)))
                if stage is self.stages[0]:
                    yield from self._look()  # the released garment lies differently
            except (UnreachableError, PerceptionError):
                if number == 1:
                    raise
                # A hand seen empty may have let go at the end of its way, and what it has carried
                # does not lie where it lay.
                yield from self._end(stage, counts=True)
                break
        return "all"

    def _give_up(self, stage: Stage) -> Part:
        yield from self._end(stage, counts=False)
        yield from self.hands.settle()

    def _end(self, stage: Stage, *, counts: bool) -> Part:
        yield from self.hands.mark(StageEnds(name=stage.name, counts=counts))
        if not self.hands.is_parked:
            yield from self.hands.retreat(stage.hands, stage.retreat)

    def _try(self, stage: Stage, number: int, reaction: Reaction) -> PartOf[Hold]:
        work = yield from self._begin(stage, number, reaction)
        actor = self.runner.actor
        if actor.is_sent or not stage.is_learned:
            if not actor.follows_steps:
                work.find_reachable()
            work.choose_turns(must_do_all=actor.follows_steps)
        yield from self.hands.mark(work.begins)
        if actor.is_sent or not stage.is_learned:
            for step in work.iterate_scripted(is_after=False):
                yield from work.perform(step)
        if stage.is_learned:
            yield from actor.act(work)
        for step in work.iterate_scripted(is_after=True):
            yield from work.perform(step)
        yield from self._end(stage, counts=True)
        if work.hold != "all":
            yield from self.hands.settle()
        return work.hold

    def _begin(self, stage: Stage, number: int, reaction: Reaction) -> PartOf[StageWork]:
        """Look at the scene, and find the points of a stage."""
        matcher = self.runner.get_matcher()
        # seen again: the stages before may have dragged the garment along
        has_objects = bool(self.hands.sensed.frames)
        sensed = yield from self.hands.look(*SENSOR_CAMERAS[: 1 + has_objects])
        cloud = sensed.see_garment()
        points = self.finder.find_stage_points(stage, cloud, matcher)
        values = self.runner.demonstration.values
        names = {**values, **name_scene(cloud, sensed.frames, points)}
        places, affordance = {}, np.zeros((len(cloud), 2), np.float32)
        if self.runner.actor.is_sent or not stage.is_learned:
            places, similarity = self.finder.find_grasps(stage, cloud, matcher, names)
            affordance = compute_affordance(similarity)
        return StageWork(
            stage=stage,
            hands=self.hands,
            names=names,
            cloud=cloud,
            places=places,
            begins=StageBegins(
                name=stage.name,
                garment_point_cloud=cloud,
                points_affordance_feature=affordance,
                object_point_cloud=sensed.see_objects() if has_objects else None,
                points=points,
                seen_at=sensed.step,
            ),
            reaction=reaction,
            draw=(self.stages.index(stage) + 1, number, self._round),
            skill=self.runner.skill,
        )
