"""HALO: the hands go where the matcher finds the demonstrated points; from there a policy takes over. Stage by stage.

Everything is given to it: what matches, the policies, and what moves the robot. It exchanges arrays with them.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Literal

import numpy as np

from dgl_sadp.errors import StageError
from dgl_sadp.halo_parts import EnvironmentDriver, HaloStage, Hold, Matcher, StageRecord

__all__ = ["HALO"]

OnLoss = Literal["give up", "lay down", "ignore"]
"""What becomes of a stage in which a hand is seen to hold nothing: it ends at once; it goes on while a hand is left, which lays
down what it holds; or nobody looks."""

_EPSILON = 1e-8  # Keeps a column of equal similarities finite. Source: original code.


class HALO:
    """Carries out a task stage by stage: match, move the hands there, let the policy act.

    Ablations are configurations: without the matcher (`use_gam=False`) the hands stay where they are and the affordance is
    zero, which is SADP alone, or DP and DP3 alone with their policies; with the matcher and policies of DP3 it is
    HALO without SADP.

    Source:
        DexGarmentLab, section on HALO; ablations "w/o GAM" and "w/o SADP".
    """

    def __init__(
        self,
        matcher: Matcher | None,
        stages: Sequence[HaloStage],
        *,
        use_gam: bool = True,
        turns_over: bool = False,
        tries: int = 3,
        rounds: int = 1,
        again_from: int = 1,
        apart: float = 0.0,
    ) -> None:
        """Take the parts.

        Args:
            matcher: What finds the demonstrated points; may be None without `use_gam`.
            stages: The task's stages in order.
            use_gam: Whether points are matched and the hands sent there.
            turns_over: Whether the garment may lie on its face. Its sides are exchanged then: where the left hand's
                point of the first stage is seen to the right (at a larger x) of the right hand's, both take each
                other's points in all stages.
            tries: How often a stage is begun at most: where a hand is seen to have come up empty, all let go, and begin
                it again from what is seen then, as an automatic collection does. 1 is once and for all.
            rounds: How often the stages are gone through at most: while the task is seen not to be done, they are
                gone through again from how the garment lies then, as in a collection.
            again_from: Number of the stage, from 1, that a further round begins with. Where there is one, a hand that
                has lost the garment in it begins the next round, after the other has laid down what it holds: dropped
                from where it is, it would lie as crumpled as before.
            apart: Least horizontal distance between the points of two hands [m], which cannot take hold of one place:
                in a heap both points of a nearly symmetric garment may look most like the side that is seen.

        Raises:
            ValueError: If there is no stage, try or round, `again_from` is no stage, or something that `use_gam` or
                `turns_over` needs is missing.
        """
        if not stages:
            raise ValueError("stages must have at least one stage; got none")
        for name, value, least in (("tries", tries, 1), ("rounds", rounds, 1), ("apart", apart, 0)):
            if value < least:
                raise ValueError(f"{name} must be at least {least}; got {value}")
        if not 1 <= again_from <= len(stages):
            raise ValueError(f"again_from must lie in 1 ... {len(stages)}; got {again_from}")
        if use_gam:
            if matcher is None:
                raise ValueError("use_gam needs a matcher; got None")
            for number, stage in enumerate(stages, start=1):
                if stage.source_cloud is None or (stage.left is None and stage.right is None):
                    raise ValueError(
                        f"use_gam needs the source_cloud of stage {number} and a point for a hand"
                    )
            if turns_over and any(stage.left is None or stage.right is None for stage in stages):
                raise ValueError("turns_over needs a point for both hands in every stage")
        self.matcher = matcher
        self.stages = tuple(stages)
        self.use_gam = use_gam
        self.turns_over = turns_over
        self.tries = tries
        self.rounds = rounds
        self.again_from = again_from
        self.apart = apart

    def run(
        self,
        driver: EnvironmentDriver,
        *,
        seed: int = 0,
        on_chunk: Callable[[int, int], None] | None = None,
    ) -> tuple[StageRecord, ...]:
        """Carry out all stages.

        Args:
            driver: The environment, after its reset.
            seed: Of what the policies draw; each stage has its own share of it.
            on_chunk: Called after each chunk with the number of the stage and of the chunk, both from 1.

        Returns:
            A record of each stage in each round.

        Raises:
            StageError: If a stage cannot be carried out, and no further round goes through it; or no stage of a round
                that begins with `again_from`.
        """
        course = _Course(self, driver, seed, on_chunk)
        first = 1
        for number in range(1, self.rounds + 1):
            if course.go_through(number, first, is_last=number == self.rounds):
                break
            first = course.choose_beginning(first)
        return tuple(course.records)


class _Course:
    """What HALO does in one environment, from its reset on."""

    def __init__(
        self,
        halo: HALO,
        driver: EnvironmentDriver,
        seed: int,
        on_chunk: Callable[[int, int], None] | None,
    ) -> None:
        self.records: list[StageRecord] = []
        self._halo, self._driver, self._seed, self._on_chunk = halo, driver, seed, on_chunk
        self._stages = list(halo.stages)
        self._places: list[np.ndarray] = []  # of the points of each stage, when the first one began
        self._carried_out: set[int] = set()

    def go_through(self, round_: int, first: int, *, is_last: bool) -> bool:
        """Carry out the stages of a round from the number `first` on; whether no further one has to follow.

        What cannot be carried out now is left out while there are further rounds: the stages after it may bring the
        garment nearer. So may those after one that has laid the garment down nearly as it should lie.
        """
        halo = self._halo
        refused: list[StageError] = []
        numbers = range(first, len(self._stages) + 1)
        for number in numbers:
            # What the next round begins with is not begun twice in this one.
            has_next = not is_last and number == halo.again_from
            try:
                hold = self._try(number, round_, is_repeated=not has_next)
            except StageError as err:
                if is_last or number < halo.again_from:
                    raise
                self._driver.end_stage(number)
                refused.append(err)
                continue
            if hold == "none" or (hold == "some" and not self._driver.is_nearly_done()):
                return False
            self._carried_out.add(number)
        if len(refused) == len(numbers) and first <= halo.again_from:
            raise refused[0]  # and would be again: the next round begins with the same
        is_whole = len(self._carried_out) == len(self._stages)
        return is_last or (is_whole and self._driver.is_done())

    def choose_beginning(self, first: int) -> int:
        """Say with which stage the round after one that began with the stage `first` begins.

        The work of the stage `again_from` is kept once if it is seen to be nearly done; what the stages after it have not
        mended then is begun anew.
        """
        again = self._halo.again_from
        may_keep = first <= again < len(self._stages) and again in self._carried_out
        return again + 1 if may_keep and self._driver.is_nearly_done() else again

    def _try(self, number: int, round_: int, *, is_repeated: bool) -> Hold:
        """Carry out a stage, if `is_repeated` again and again while the garment is lost. How much of it is held at last.

        Where a further try cannot find the points, or not reach them, the stage counts as carried out: a hand seen empty may
        have let go at the end of its way, and what it has folded does not lie where it lay.
        """
        if not is_repeated:
            return self._carry_out(number, round_, 1, on_loss="lay down")
        tries = self._halo.tries
        for attempt in range(1, tries + 1):
            try:
                on_loss = "give up" if attempt < tries else "ignore"
                if self._carry_out(number, round_, attempt, on_loss=on_loss) == "all":
                    break
            except StageError:
                if attempt == 1:
                    raise
                self._driver.end_stage(number)
                break
        return "all"  # as far as it is looked for: in the last try nobody looks

    def _carry_out(self, number: int, round_: int, attempt: int, *, on_loss: OnLoss) -> Hold:
        """Carry out a stage; returns the least hold that was seen."""
        driver, halo = self._driver, self._halo
        observation = dict(driver.begin_stage(number))
        cloud = np.asarray(observation["garment_point_cloud"])
        if halo.use_gam and number == 1:
            self._look(cloud)
        stage = self._stages[number - 1]
        record, affordance = self._match(number, stage, cloud)
        if halo.use_gam:
            driver.move_hands(record.left, record.right)
        observation["points_affordance_feature"] = affordance
        # A first try draws what it would have drawn without any other.
        again = [] if round_ == attempt == 1 else [attempt] if round_ == 1 else [attempt, round_]
        drawn = int(np.random.SeedSequence([self._seed, number, *again]).generate_state(1)[0])
        stage.policy.reset(observation, seed=drawn)
        executed, hold = self._act(number, stage, on_loss=on_loss)
        driver.end_stage(number)
        if attempt > 1:  # One record for all tries of a stage.
            executed += self.records.pop().targets
        self.records.append(replace(record, round=round_, targets=executed, tries=attempt))
        return hold

    def _act(self, number: int, stage: HaloStage, *, on_loss: OnLoss) -> tuple[int, Hold]:
        """Let the policy act; returns how many targets it gave, and the least hold that was seen."""
        executed = 0
        least: Hold = "all"
        seen = self._driver.observe()
        for chunk in range(1, stage.chunks + 1):
            targets = stage.policy.act(seen)
            for index, target in enumerate(targets):
                seen = self._driver.execute(target)
                executed += 1
                if index + 1 < len(targets):
                    stage.policy.observe(seen)
            if self._on_chunk is not None:
                self._on_chunk(number, chunk)
            if on_loss == "ignore":
                continue
            hold = self._driver.see_hold()
            if hold != "all":
                least = hold
            if hold == "none" or (hold == "some" and on_loss == "give up"):
                break
        return executed, least

    def _look(self, cloud: np.ndarray) -> None:
        """See in a cloud, shape (N, 3), on which side the garment lies, and where all points are before the first stage."""
        self._stages = list(self._halo.stages)
        if self._halo.turns_over:
            left, right = cloud[self._ask(self._stages[0], cloud)[0]]
            if left[0] > right[0]:
                self._stages = [replace(s, left=s.right, right=s.left) for s in self._stages]
        self._places = [cloud[self._ask(each, cloud)[0]] for each in self._stages]

    def _match(
        self, number: int, stage: HaloStage, cloud: np.ndarray
    ) -> tuple[StageRecord, np.ndarray]:
        """Find the points of the hands on a cloud, shape (N, 3), and the affordance of both, shape (N, 2)."""
        nothing = StageRecord(
            stage=number, round=0, left=None, right=None, similarity=(), targets=0, tries=0
        )
        if not self._halo.use_gam:
            return nothing, np.zeros((len(cloud), 2), np.float32)
        indices, similarity = self._ask(stage, cloud)
        if number > 1 and stage.moved_at_most is not None:
            offset = cloud[None, :, :2] - self._places[number - 1][:, None, :2]
            near = np.linalg.norm(offset, axis=2) <= stage.moved_at_most
            if not near.any(axis=1).all():
                raise StageError(
                    f"stage {number}: nothing of the garment lies within {stage.moved_at_most} m of "
                    "where a point was"
                )
            near_alone = np.where(near, similarity, -np.inf)
            indices = _part(near_alone.argmax(axis=1), near_alone, cloud, self._halo.apart)
            similarity = np.where(near, similarity, similarity.min(axis=1, keepdims=True))
        found = [cloud[int(index)] for index in indices]
        record = replace(
            nothing,
            left=found[0] if stage.left is not None else None,
            right=found[-1] if stage.right is not None else None,
            similarity=tuple(
                float(row[int(index)]) for row, index in zip(similarity, indices, strict=True)
            ),
        )
        return record, scale_affordance(similarity)

    def _ask(self, stage: HaloStage, cloud: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Match the stage's points: their indices in the cloud, shape (K,), and the similarity, shape (K, N)."""
        assert self._halo.matcher is not None
        assert stage.source_cloud is not None
        wanted = [point for point in (stage.left, stage.right) if point is not None]
        indices, similarity = self._halo.matcher.match(stage.source_cloud, np.stack(wanted), cloud)
        indices, similarity = np.asarray(indices), np.asarray(similarity, dtype=np.float64)
        shape = (len(wanted), len(cloud))
        if indices.shape != shape[:1] or similarity.shape != shape:
            raise ValueError(
                f"the matcher must return shapes {shape[:1]} and {shape}; "
                f"got {indices.shape} and {similarity.shape}"
            )
        return _part(indices, similarity, cloud, self._halo.apart), similarity


def _part(found: np.ndarray, similarity: np.ndarray, cloud: np.ndarray, apart: float) -> np.ndarray:
    """Give two points that were found nearer to each other than `apart` [m] two places, if the cloud has them.

    Args:
        found: Indices of the most similar points, shape (K,), K of 1 or 2.
        similarity: Of both to each point of the cloud, shape (K, N); minus infinity where they cannot be.
        cloud: Shape (N, 3), world frame.
        apart: Horizontal distance [m].

    Returns:
        Indices, shape (K,): of the pair that is so far apart with the largest sum of similarities, where one was needed.
    """
    # As `dgl_gam.choose_pair`; any matcher will do here, so this package does without that one.
    flat = cloud[:, :2]
    if len(found) < 2 or np.linalg.norm(flat[found[0]] - flat[found[1]]) >= apart:
        return found
    is_apart = np.linalg.norm(flat[:, None] - flat[None], axis=2) >= apart
    total = np.where(is_apart, similarity[0][:, None] + similarity[1][None], -np.inf)
    if not np.isfinite(total.max()):
        return found
    return np.array(np.unravel_index(total.argmax(), total.shape))


def scale_affordance(similarity: np.ndarray) -> np.ndarray:
    """Scale similarities of one or two points, shape (K, N), to channels (left, right) in [0, 1], shape (N, 2).

    The only point of a one-handed stage stands in both channels, as in the recorded data.
    """
    lowest = similarity.min(axis=1, keepdims=True)
    spread = similarity.max(axis=1, keepdims=True) - lowest
    columns = ((similarity - lowest) / (spread + _EPSILON)).T.astype(np.float32)
    return np.repeat(columns, 2, axis=1) if columns.shape[1] == 1 else columns
