"""Thresholded Kruskal's algorithm over the sorted edges, with cached subtrees (see merge.py)."""

from ellipseg_ros.core.criteria import merge_distance
from ellipseg_ros.core.dendrogram import NONE, release
from ellipseg_ros.core.edge_sorting import comes_before
from ellipseg_ros.core.jit import inlined, kernel
from ellipseg_ros.core.wakeup_heap import due, next_weight, pop, push


@kernel
def kruskal(dendrogram, edges, rule, heap, min_active):
    """Test the edges with at least `min_active` active ends; merge where D(a, b) <= threshold.

    heap: the cached subtrees by the edge at which they become active.
    """
    weight, edge_i, edge_j = edges
    moments, value, distance = dendrogram.moments, dendrogram.value, dendrogram.distance
    active, free, ancestor = dendrogram.active, dendrogram.free, dendrogram.ancestor
    made = dendrogram.made
    wakeup = next_weight(heap)
    for e in range(len(weight)):
        w, i, j = weight[e], edge_i[e], edge_j[e]
        if w >= wakeup:
            while due(heap, w, i, j):
                _activate(pop(heap), dendrogram)
            wakeup = next_weight(heap)
        if int(active[i]) + int(active[j]) < min_active:
            continue
        a = _state_before(ancestor, made, i, w, i, j)
        b = _state_before(ancestor, made, j, w, i, j)
        if a == b:
            continue
        union = free[free[-1] - 1]
        distance[union] = merge_distance(moments, value, a, b, union, rule)
        if distance[union] > rule.threshold:
            continue
        free[-1] -= 1
        if not active[i]:
            _invalidate(a, dendrogram, heap)
        if not active[j]:
            _invalidate(b, dendrogram, heap)
        wakeup = next_weight(heap)
        _link(a, b, union, dendrogram)
        edge = made[union]
        edge.weight, edge.i, edge.j = w, i, j


@inlined
def _state_before(ancestor, made, node, w, i, j):
    """The highest ancestor of a vertex that was made before the edge (w, i, j).

    Halving the path to it is allowed, as the edges ascend.
    """
    while True:
        up = ancestor[node]
        edge = made[up]
        if up == node or not comes_before(edge.weight, edge.i, edge.j, w, i, j):
            return node
        higher = ancestor[up]
        edge = made[higher]
        if higher == up or not comes_before(edge.weight, edge.i, edge.j, w, i, j):
            return up
        ancestor[node] = higher
        node = higher


@kernel
def _link(a, b, union, dendrogram):
    dendrogram.left[union], dendrogram.right[union] = a, b
    dendrogram.parent[a] = dendrogram.parent[b] = union
    dendrogram.ancestor[a] = dendrogram.ancestor[b] = union
    dendrogram.parent[union], dendrogram.ancestor[union] = NONE, union


@kernel
def _invalidate(node, dendrogram, heap):
    """Activate a cached subtree that merges with an active segment; release the unions above it.

    The siblings on the way up stay cached, each until the edge at which its parent was made.
    """
    parent, left, right = dendrogram.parent, dendrogram.left, dendrogram.right
    ancestor = dendrogram.ancestor
    _activate(node, dendrogram)
    below, up = node, parent[node]
    parent[node] = NONE
    while up != NONE:
        sibling = right[up] if left[up] == below else left[up]
        parent[sibling], ancestor[sibling] = NONE, sibling
        push(heap, sibling, dendrogram.made[up])
        below, higher = up, parent[up]
        release(up, dendrogram)
        up = higher


@kernel
def _activate(node, dendrogram):
    """Mark the vertices of a subtree active; none if it has been released in the meantime."""
    left, right, active = dendrogram.left, dendrogram.right, dendrogram.active
    stack = [node]
    while len(stack) > 0:
        node = stack.pop()
        if node < len(active):
            active[node] = True
        elif left[node] != NONE:
            stack.append(left[node])
            stack.append(right[node])
