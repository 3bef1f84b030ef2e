"""The kd-trees over the rows of a graph: a large one, and one of the rows added since."""

import numpy as np

from ellipseg_ros.core.knn import kdtree
from ellipseg_ros.records import Array

REBUILD_SHARE = 0.25  # of the living rows outside the large tree, or dead in it: build it again


class Trees:
    """Trees that hold every living row once, and are built again when they have aged."""

    def __init__(self) -> None:
        self.trees: list[kdtree.Tree] = []
        self._indexed_rows = 0  # rows before this one are in the large tree,
        self._dead_at_build = 0  # but for this number, which were dead already

    def clear(self) -> None:
        """Forget the trees, since the rows have new numbers."""
        self.trees = []
        self._indexed_rows = self._dead_at_build = 0

    def add(self, points: Array, state: Array, count: int) -> None:
        """Index the rows up to `count` that are in no tree yet; state (rows,): 0 is dead."""
        living = np.flatnonzero(state)
        dead = np.count_nonzero(state[: self._indexed_rows] == 0) - self._dead_at_build
        if dead + count - self._indexed_rows > REBUILD_SHARE * len(living):
            self.trees = [kdtree.build(points, living)]
            self._indexed_rows, self._dead_at_build = count, count - len(living)
        else:
            later = living[np.searchsorted(living, self._indexed_rows) :]
            self.trees[1:] = [kdtree.build(points, later)]
