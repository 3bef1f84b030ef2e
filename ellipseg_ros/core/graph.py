"""The k-nearest-neighbour graph of the points in the window, kept up to date.

Rows are points in the order of arrival, so that ties by row are ties by arrival. A row is not used
twice; when many are dead, the living ones get new numbers (`GraphChange.kept_rows`).
"""

import copy
from typing import NamedTuple

import numpy as np

from ellipseg_ros.config import GraphConfig
from ellipseg_ros.core.edge_sorting import no_edges
from ellipseg_ros.core.edges import update_edges
from ellipseg_ros.core.ellipsoids import initial_ellipsoids
from ellipseg_ros.core.jit import for_rows, kernel
from ellipseg_ros.core.knn import kdtree
from ellipseg_ros.core.knn.invalidation import lacks_neighbour, rows_gaining, rows_losing
from ellipseg_ros.core.knn.search import Search, search_neighbours
from ellipseg_ros.core.knn.trees import Trees
from ellipseg_ros.core.moments import no_moments
from ellipseg_ros.core.rows import moved, row_map
from ellipseg_ros.core.window import Arrivals
from ellipseg_ros.records import Array

DEAD, ISOLATED, MEMBER = range(3)  # state of a row; members are the vertices of the graph
# Capacity: rows made per row needed; the share of dead rows at which the living are renumbered;
# rows per row needed, beyond the first MIN_LARGE_CAPACITY, at which memory is returned.
SPARE_FACTOR = 1.5
DEAD_SHARE = 0.25
SHRINK_FACTOR, MIN_LARGE_CAPACITY = 5, 5_000


class GraphChange(NamedTuple):
    """Effect of an update on the graph; arrays (rows,) bool, by the new rows."""

    dirty: Array  # members whose neighbours changed, new ones included
    removed: Array  # members before the update, not after it
    member: Array  # the vertices
    kept_rows: Array | None = None  # (n,) ascending: old rows that are 0 to n - 1 now; None: all

    def without_changes(self) -> "GraphChange":
        """The change of an update that changes nothing."""
        nothing = np.zeros_like(self.member)
        return GraphChange(nothing, nothing, self.member)


class Graph:
    """Points, their k nearest neighbours, initial ellipsoids and edges.

    Neighbours ascend by (d^2, row), d^2 = (dx^2 + dy^2) + dz^2; a point is not its own neighbour.
    Isolated points are no members; they may become members later.
    """

    def __init__(self, config: GraphConfig) -> None:
        self._config = config
        self._trees = Trees()
        self.count = 0  # rows in use
        self.points = np.zeros((0, 3))  # (rows, 3) float64, m, local origin
        self.serial = np.zeros(0, np.int64)  # (rows,) serial numbers of the points, ascending
        self.state = np.zeros(0, np.uint8)  # (rows,) DEAD, ISOLATED or MEMBER
        self.knn_indices = np.zeros((0, config.neighbours), np.int32)  # (rows, k), -1 for none
        self._squared = np.zeros((0, config.neighbours))  # (rows, k) m^2, inf for none
        # (2 rows,) MOMENTS: initial ellipsoids, then room for the unions of a Merge.
        self.moments = no_moments()
        self.edges = no_edges()

    def update(self, arrivals: Arrivals) -> GraphChange:
        """Add the new points, remove the expired ones, and renew what that changes."""
        kept_rows = self._make_room(len(arrivals.points))
        change = self._update_neighbours(arrivals)
        rows = np.flatnonzero(change.dirty)
        initial_ellipsoids(self.points, self.knn_indices, rows, self.moments)
        self.edges = update_edges(
            self.edges, self.knn_indices, self.moments, change.dirty, change.member
        )
        return change._replace(kept_rows=kept_rows)

    def with_own_unions(self) -> "Graph":
        """The same graph, read only but for the room of the unions: for a Merge of its own."""
        graph = copy.copy(self)
        graph.moments = self.moments.copy()
        return graph

    def _make_room(self, arriving: int) -> Array | None:
        """Drop the dead rows where they are many, or no room is left; returns those kept, then."""
        capacity = len(self.state)
        living = np.flatnonzero(self.state)
        dead = self.count - len(living)
        needed = len(living) + arriving
        max_capacity = MIN_LARGE_CAPACITY + SHRINK_FACTOR * needed
        if self.count + arriving <= capacity <= max_capacity and dead <= DEAD_SHARE * capacity:
            return None
        if needed > (1.0 - DEAD_SHARE / 2.0) * capacity or capacity > max_capacity:
            capacity = round(SPARE_FACTOR * needed) if len(living) else needed
        self._renumber(living, capacity)
        return living

    def _renumber(self, kept_rows: Array, capacity: int) -> None:
        count, new_rows = len(kept_rows), row_map(kept_rows, self.count)
        edges = self.edges
        self.edges = edges._replace(i=new_rows[edges.i], j=new_rows[edges.j])
        self.knn_indices = moved(self.knn_indices, kept_rows, capacity)
        self.knn_indices[:count] = new_rows[self.knn_indices[:count]]
        self._squared = moved(self._squared, kept_rows, capacity)
        self.points = moved(self.points, kept_rows, capacity)
        self.serial = moved(self.serial, kept_rows, capacity)
        self.state = moved(self.state, kept_rows, capacity)
        self.state[count:] = DEAD
        self.moments = moved(self.moments, kept_rows, 2 * capacity)
        self.count = count
        self._trees.clear()

    def _update_neighbours(self, arrivals: Arrivals) -> GraphChange:
        """Membership comes first: a point that gains its first neighbour within the isolation
        distance enters, one that loses its last leaves; for the others that is arrival and expiry.
        """
        was_member = self.state == MEMBER
        expired = self._replace_points(arrivals)
        self._trees.add(self.points, self.state, self.count)

        # Points with unknown or lost neighbours search among all living points.
        searched = (self.state == ISOLATED) | self._losing(self.state == MEMBER, expired)
        self._search(searched, ISOLATED)
        limit = self._config.isolation_distance * self._config.isolation_distance
        connected = searched & (self._squared[:, 0] <= limit)
        self.state[searched] = ISOLATED
        self.state[connected] = MEMBER
        member = self.state == MEMBER

        # Points with an isolated neighbour, or that gain or lose one, search among the members.
        left = np.flatnonzero(searched & was_member & ~connected)
        again = self._has_isolated_neighbour(connected)
        if len(left):
            again |= self._losing(member, left)
        settled = member & ~searched
        if settled.any():
            entered = np.flatnonzero(connected & ~was_member)
            nearer = kdtree.build(self.points, entered)
            again |= rows_gaining(self._trees.trees, nearer, self._query(settled, MEMBER))
        self._search(again, MEMBER)
        self.knn_indices[searched & ~connected] = -1
        return GraphChange(connected | again, was_member & ~member, member)

    def _replace_points(self, arrivals: Arrivals) -> Array:
        """Mark the expired rows dead, append the new points; returns the rows that expired."""
        expired = np.searchsorted(self.serial[: self.count], arrivals.expired)
        self.state[expired] = DEAD
        new = slice(self.count, self.count + len(arrivals.points))
        self.points[new], self.serial[new] = arrivals.points, arrivals.serial
        self.state[new] = ISOLATED
        self.count = new.stop
        return expired

    def _query(self, rows: Array, min_state: int) -> Search:
        return Search(rows, self.state, min_state, self.knn_indices, self._squared)

    def _search(self, rows: Array, min_state: int) -> None:
        search_neighbours(self._trees.trees, self._query(rows, min_state))

    def _losing(self, rows: Array, left: Array) -> Array:
        leaving = kdtree.build(self.points, left)
        return rows_losing(self._trees.trees, leaving, self._query(rows, MEMBER))

    def _has_isolated_neighbour(self, rows: Array) -> Array:
        """(rows,) bool: those of `rows` that lack a neighbour, or have one that is no member."""
        incomplete = np.zeros(len(rows), bool)
        for_rows(_incomplete, self.count, rows, self.state, self.knn_indices, incomplete)
        return incomplete


@kernel
def _incomplete(start, stop, rows, state, knn_indices, incomplete):
    for row in range(start, stop):
        if rows[row]:
            incomplete[row] = lacks_neighbour(row, knn_indices, state, MEMBER)
