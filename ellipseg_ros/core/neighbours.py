"""The graph's vertices and their nearest neighbours, kept up to date.

Rows are vertices in the order of arrival, so that ties by row are ties by arrival. A row is not
used again; `Neighbours.renumber` drops the dead ones when they have become many.
"""

from typing import NamedTuple

import numpy as np

from ellipseg_ros.config import GraphConfig
from ellipseg_ros.core.jit import for_rows, kernel
from ellipseg_ros.core.knn import kdtree
from ellipseg_ros.core.knn.invalidation import gaining, lacks, losing
from ellipseg_ros.core.knn.search import Search, nearest
from ellipseg_ros.records import Array

DEAD, ISOLATED, MEMBER = range(3)  # status of a row; only members are vertices of the graph
STALE = 0.25  # share of the points outside the main tree, or dead in it, at which it is built anew


class Change(NamedTuple):
    """What an update did to the graph; arrays by row, (rows,) bool."""

    dirty: Array  # members whose neighbours changed, entered ones too
    gone: Array  # members of before that are none now
    member: Array  # vertices of the graph


class Neighbours:
    """The k nearest neighbours of every vertex; isolated points take no part, but may later.

    Ascending by (d^2, row), d^2 = (dx^2 + dy^2) + dz^2; a vertex is not its own neighbour.
    """

    def __init__(self, config: GraphConfig) -> None:
        self._config = config
        self.count = 0  # rows in use
        self.points = np.zeros((0, 3))  # (rows, 3) float64, m, local origin
        self.serial = np.zeros(0, np.int64)  # (rows,) serial numbers of the points, ascending
        self.status = np.zeros(0, np.uint8)  # (rows,) DEAD, ISOLATED or MEMBER
        self.rows = np.zeros((0, config.neighbours), np.int32)  # (rows, k), -1 for none
        self._squared = np.zeros((0, config.neighbours))  # (rows, k) m^2, inf for none
        self._trees: list[kdtree.Tree] = []  # the main one, and one of later arrivals
        self._planted = 0  # rows before are in the main tree,
        self._rotten = 0  # but for so many that were dead already

    def renumber(self, keep: Array, capacity: int) -> None:
        """Keep the rows `keep` (n,) ascending, as 0 to n - 1, in arrays of `capacity` rows."""
        names = np.full(self.count + 1, -1, np.int32)  # row -1 is the last: none stays none
        names[keep] = np.arange(len(keep))
        self.rows = moved(self.rows, keep, capacity)
        self.rows[: len(keep)] = names[self.rows[: len(keep)]]
        self.points = moved(self.points, keep, capacity)
        self.serial = moved(self.serial, keep, capacity)
        self.status = moved(self.status, keep, capacity)
        self.status[len(keep) :] = DEAD
        self._squared = moved(self._squared, keep, capacity)
        self.count = len(keep)
        self._planted = self._rotten = 0  # the next update plants

    def update(self, arrived: Array, serial: Array, expired: Array) -> Change:
        """Take new points (m, 3) with serial numbers (m,), let those numbered `expired` go.

        Membership comes first: a point that gains its first neighbour within the isolation
        distance enters, one that loses its last leaves; to the others that is arrival and expiry.
        """
        was_member = self.status == MEMBER
        dead = np.searchsorted(self.serial[: self.count], expired)
        self.status[dead] = DEAD
        new = slice(self.count, self.count + len(arrived))
        self.count = new.stop
        self.points[new], self.serial[new] = arrived, serial
        self.status[new] = ISOLATED
        self._grow_trees()

        # Everybody whose neighbours are lost or unknown asks among all living points.
        ask = (self.status == ISOLATED) | self._losing(self.status == MEMBER, dead)
        self._search(ask, ISOLATED)
        limit = self._config.isolation_distance * self._config.isolation_distance
        enters = ask & (self._squared[:, 0] <= limit)
        self.status[ask] = ISOLATED
        self.status[enters] = MEMBER
        member = self.status == MEMBER
        entered = np.flatnonzero(enters & ~was_member)

        # Those that met an isolated one, lost one to isolation, or gained one, ask among members.
        left = np.flatnonzero(ask & was_member & ~enters)
        again = self._incomplete(enters)
        if len(left):
            again |= self._losing(member, left)
        settled = member & ~ask
        if settled.any():
            again |= self._gaining(settled, entered)
        self._search(again, MEMBER)
        self.rows[ask & ~enters] = -1
        return Change(enters | again, was_member & ~member, member)

    def _grow_trees(self) -> None:
        """Plant the rows that are in no tree yet; all anew when many are dead or outside."""
        living = np.count_nonzero(self.status)
        dead = np.count_nonzero(self.status[: self._planted] == DEAD) - self._rotten
        if dead + self.count - self._planted > STALE * living:
            self._plant()
        else:
            later = np.arange(self._planted, self.count)
            self._trees[1:] = [kdtree.build(self.points, later[self.status[later] != DEAD])]

    def _plant(self) -> None:
        living = np.flatnonzero(self.status)
        self._trees = [kdtree.build(self.points, living)]
        self._planted = self.count
        self._rotten = self.count - len(living)

    def _query(self, wanted: Array, least: int) -> Search:
        return Search(wanted, self.status, least, self.rows, self._squared)

    def _search(self, wanted: Array, least: int) -> None:
        nearest(self._trees, self._query(wanted, least))

    def _gaining(self, wanted: Array, entered: Array) -> Array:
        entering = kdtree.build(self.points, entered)
        return gaining(self._trees, entering, self._query(wanted, MEMBER))

    def _losing(self, wanted: Array, lost: Array) -> Array:
        leaving = kdtree.build(self.points, lost)
        return losing(self._trees, leaving, self._query(wanted, MEMBER))

    def _incomplete(self, wanted: Array) -> Array:
        """(rows,) bool: the wanted rows that lack a neighbour, or have one that is no member."""
        flags = np.zeros(len(wanted), bool)
        for_rows(_incomplete, self.count, wanted, self.status, self.rows, flags)
        return flags


def moved(values: Array, keep: Array, capacity: int) -> Array:
    """The rows `keep` (n,) ascending as the first n of an array of `capacity` rows.

    In place where the capacity stays: at hundreds of bytes a row, new memory costs most time.
    The rows beyond n hold anything.
    """
    target = values
    if len(values) != capacity:
        target = np.empty((capacity, *values.shape[1:]), values.dtype)
    if len(keep):
        _move(values.reshape(len(values), -1), keep, target.reshape(capacity, -1))
    return target


@kernel
def _move(values, keep, target):
    for k in range(len(keep)):
        for column in range(values.shape[1]):
            target[k, column] = values[keep[k], column]


@kernel
def _incomplete(start, stop, wanted, status, rows, flags):
    for row in range(start, stop):
        if wanted[row]:
            flags[row] = lacks(row, rows, status, MEMBER)
