"""The whole method once more: plain, slow, written from the equations of
docs/explanation/method.md.

Nothing of the package is imported. Points are (n, 3) float64 arrays; a moment is (count, mean,
covariance).
"""

import math
from collections import Counter

import numpy as np

K = 9


def squared_distance(p, q):
    dx, dy, dz = float(q[0] - p[0]), float(q[1] - p[1]), float(q[2] - p[2])
    return (dx * dx + dy * dy) + dz * dz


def nearest(points, i, members, k):
    """The k members nearest to i, itself left out, ascending by (d^2, index)."""
    near = sorted((squared_distance(points[i], points[j]), j) for j in members if j != i)
    return [j for _, j in near[:k]]


def isolated(points, distance):
    everybody = range(len(points))
    return [
        not any(
            squared_distance(points[i], points[j]) <= distance * distance
            for j in everybody
            if j != i
        )
        for i in everybody
    ]


def neighbours(points, k=10, distance=2.0):
    """Neighbour lists, None for the isolated points (which are removed first)."""
    alone = isolated(points, distance)
    members = [i for i in range(len(points)) if not alone[i]]
    return [None if alone[i] else nearest(points, i, members, k) for i in range(len(points))]


def moments(points):
    mean = np.mean(points, axis=0)
    delta = points - mean
    return len(points), mean, delta.T @ delta / len(points)


def initial_ellipsoid(points, i, near):
    """Eq. 2 over N(i), i itself among them; about i, so that no distance costs digits."""
    _, mean, covariance = moments(np.asarray([points[j] - points[i] for j in [i, *near]]))
    return 1, points[i] + mean, covariance


def eigen(covariance):
    """Eigenvalues descending and clipped, axes as rows."""
    values, vectors = np.linalg.eigh(covariance)
    values = np.maximum(values[::-1], 0.0)
    if values.sum() == 0.0:
        return values, np.eye(3)
    v1, v2 = vectors[:, 2], vectors[:, 1]
    v1 = v1 * np.sign(v1[np.argmax(np.abs(v1))])
    v2 = v2 * np.sign(v2[np.argmax(np.abs(v2))])
    return values, np.array([v1, v2, np.cross(v1, v2)])


def shape(values):
    """Planarity, cylindricality, sphericity: eqs. 3-5."""
    e1, e2, e3 = values
    total = e1 + e2 + e3
    if total == 0.0:
        return 0.0, 0.0, 1.0
    return 2 * (e2 - e3) / total, (e1 - e2) / total, 3 * e3 / total


def edges(lists):
    pairs = {(min(i, j), max(i, j)) for i, near in enumerate(lists) if near for j in near}
    return sorted(pairs)


def edge_weight(a, b):
    (_, mean_a, cov_a), (_, mean_b, cov_b) = a, b
    (values_a, axes_a), (values_b, axes_b) = eigen(cov_a), eigen(cov_b)
    delta = mean_b - mean_a
    gap = np.linalg.norm(delta)
    planarity = (shape(values_a)[0] + shape(values_b)[0]) / 2
    tilt = max(0.0, 1 - (axes_a[2] @ axes_b[2]) ** 2)
    across = (abs(axes_a[2] @ delta) + abs(axes_b[2] @ delta)) / 2
    return gap + planarity * (gap * tilt + across)


def union(a, b):
    (na, mean_a, cov_a), (nb, mean_b, cov_b) = a, b
    n, delta = na + nb, mean_b - mean_a
    mean = (na * mean_a + nb * mean_b) / n
    return n, mean, (na * cov_a + nb * cov_b) / n + na * nb / n**2 * np.outer(delta, delta)


def shape_distance(a, b, floor=1e-4):
    """Eq. 7, with e1 in the spherical term."""
    (na, mean_a, cov_a), (nb, mean_b, cov_b) = a, b
    fa = na / (na + nb)
    fb = 1 - fa
    delta = mean_b - mean_a
    (values_a, va), (values_b, vb) = eigen(cov_a), eigen(cov_b)
    (pa, ca, sa), (pb, cb, sb) = shape(values_a), shape(values_b)
    ea, eb = np.maximum(values_a, floor), np.maximum(values_b, floor)
    planar = (
        fa * (va[2] @ delta) ** 2 / ea[2]
        + fb * (vb[2] @ delta) ** 2 / eb[2]
        + (fa * pa + fb * pb) * (1 - (va[2] @ vb[2]) ** 2) / (ea[2] / ea[1] + eb[2] / eb[1])
    )
    cylindrical = (
        fa * (1 - pa) * (va[1] @ delta) ** 2 / ea[1]
        + fb * (1 - pb) * (vb[1] @ delta) ** 2 / eb[1]
        + (fa * ca + fb * cb) * (1 - (va[0] @ vb[0]) ** 2) / (ea[1] / ea[0] + eb[1] / eb[0])
    )
    spherical = fa * sa * (va[0] @ delta) ** 2 / ea[0] + fb * sb * (vb[0] @ delta) ** 2 / eb[0]
    return planar + cylindrical + spherical


def mass(points, i, near):
    """Eq. 6: the squared mean distance to the neighbours."""
    return float(np.mean([math.sqrt(squared_distance(points[i], points[j])) for j in near])) ** 2


def density_distance(a, b, mass_ab):
    n, _, covariance = union(a, b)
    values, _ = eigen(covariance)
    volume = 4 / 3 * math.pi * math.sqrt(float(np.prod(values)))
    if volume == 0.0:
        return 0.0
    return volume * n / mass_ab if mass_ab > 0 else math.inf


def aicc(segment, noise=0.01):
    """Eqs. 9-14."""
    n, _, covariance = segment
    e, _ = eigen(covariance)
    p, _, s = shape(e)
    modulated = [max(e[0] * s, noise), max(e[1] * (1 - p), noise), max(e[2], noise)]
    variance = n * (3 * math.log(2 * math.pi) + sum(map(math.log, modulated)) + 3)
    return variance + 2 * K * n / max(1, n - K - 1)


def segment(points, criterion, tau, order=None, k=10):
    """Segments as [(sorted members, model moments)], by the lowest member; isolated points.

    order: the edges as (i, j), where another rounding than that of edge_weight decides between
    equal weights (points with the same N make many).
    """
    lists = neighbours(points, k)
    alive = [i for i, near in enumerate(lists) if near is not None]
    of = {i: i for i in alive}  # point -> segment
    members = {i: [i] for i in alive}
    model = {i: initial_ellipsoid(points, i, lists[i]) for i in alive}
    masses = {i: mass(points, i, lists[i]) for i in alive}
    if order is None:
        order = sorted(edges(lists), key=lambda e: (edge_weight(model[e[0]], model[e[1]]), *e))
    for i, j in order:
        a, b = of[i], of[j]
        if a == b:
            continue
        if criterion == "shape":
            distance = shape_distance(model[a], model[b])
        elif criterion == "density":
            distance = density_distance(model[a], model[b], masses[a] + masses[b])
        else:
            distance = aicc(union(model[a], model[b])) - aicc(model[a]) - aicc(model[b])
        if distance <= tau:
            model[a] = union(model[a], model[b])
            masses[a] += masses[b]
            members[a] += members.pop(b)
            for point in members[a]:
                of[point] = a
    found = sorted((sorted(members[s]), s) for s in members)
    return [(rows, model[s]) for rows, s in found], [i for i in range(len(points)) if i not in of]


def inherit(before, now, next_id):
    """Ids of new segments; before: [(id, set of points)], now: [set of points]."""
    share = {(id_, s): len(old & new) for id_, old in before for s, new in enumerate(now)}
    ids = []
    for s in range(len(now)):
        mine = max((id_ for id_, _ in before), key=lambda i: (share[i, s], -i), default=None)
        if mine is not None and share[mine, s] > 0:
            heir = max(range(len(now)), key=lambda t: (share[mine, t], -t))
            if heir == s:
                ids.append(mine)
                continue
        ids.append(next_id)
        next_id += 1
    return ids


# --- objects ---------------------------------------------------------------------------------


def features(covariance):
    """Linearity, planarity, scattering, twice the verticality (Guinard & Landrieu 2017)."""
    values, axes = eigen(covariance)
    s = np.sqrt(values)
    if s[0] == 0.0:
        return np.zeros(4)
    sum_of_axes = s @ np.abs(axes)
    up = sum_of_axes[2] / np.linalg.norm(sum_of_axes)
    return np.array([(s[0] - s[1]) / s[0], (s[1] - s[2]) / s[0], s[2] / s[0], 2 * up])


def boundaries(lists, labels):
    """{(a, b): edges between the segments a < b}; labels of the points, -1 for none."""
    lengths = {}
    for i, j in edges(lists):
        a, b = sorted((labels[i], labels[j]))
        if a != b:
            lengths[a, b] = lengths.get((a, b), 0) + 1
    return lengths


def hierarchy(moments_of, features_of, lengths, thickness):
    """All merges of segments into objects as (into, merged, cost), the best pair first."""
    moments_of, features_of, lengths = dict(moments_of), dict(features_of), dict(lengths)
    merges = []

    def flat(a, b):
        halves = [(1, *moments_of[group][1:]) for group in (a, b)]
        thinnest = eigen(union(*halves)[2])[0][2]
        return thinnest if thinnest <= thickness**2 else math.inf

    def alike(a, b):
        na, nb = moments_of[a][0], moments_of[b][0]
        squared = float(np.sum((features_of[a] - features_of[b]) ** 2))
        return na * nb / (na + nb) * squared / math.sqrt(lengths[a, b])

    for cost_of in (flat, alike):
        while lengths:
            cost, a, b = min((cost_of(a, b), a, b) for a, b in lengths)
            if cost == math.inf:
                break
            merges.append((a, b, 0.0 if cost_of is flat else cost))
            na, nb = moments_of[a][0], moments_of[b][0]
            features_of[a] = (na * features_of[a] + nb * features_of[b]) / (na + nb)
            moments_of[a] = union(moments_of[a], moments_of[b])
            del lengths[a, b]
            for pair in [pair for pair in lengths if b in pair]:
                other = pair[0] + pair[1] - b
                renamed = (min(a, other), max(a, other))
                lengths[renamed] = lengths.get(renamed, 0) + lengths.pop(pair)
    return merges


def cut(merges, segments, scale):
    """The object of every segment when merges stop before the first that costs more."""
    group = list(range(segments))
    for into, merged, cost in merges:
        if cost > scale:
            break
        group = [into if g == merged else g for g in group]
    names = sorted(set(group))
    return [names.index(g) for g in group]


# --- tables and graphs -----------------------------------------------------------------------


def contingency(rows, columns):
    """{(row, column): number of items}; negative labels are left out."""
    pairs = ((r, c) for r, c in zip(rows, columns, strict=True) if r >= 0 and c >= 0)
    return Counter(pairs)


def maximal_cliques(consistent, max_cliques):
    """Greedy maximal cliques of a boolean matrix, each ascending, by descending size."""
    adjacent = [set(np.flatnonzero(row).tolist()) for row in consistent]
    free, cliques = set(range(len(adjacent))), []
    while free and len(cliques) < max_cliques:
        root = min(free, key=lambda v: (-len(adjacent[v]), v))
        clique, joinable = {root}, set(adjacent[root])
        while joinable:
            best = min(joinable, key=lambda v: (-len(adjacent[v] & joinable), v))
            clique.add(best)
            joinable &= adjacent[best]
        cliques.append(sorted(clique))
        free -= clique
    return sorted(cliques, key=len, reverse=True)


# --- landmarks -------------------------------------------------------------------------------


def landmark_residual(direction, determined, one, other):
    """Residual (d,) of a landmark against another one, and its covariance (d, d).

    direction: column of the axes that is the landmark's direction, None for a blob; determined:
    the motions of six that it determines; one, other: position (3,), axes (3, 3), covariance
    (6, 6) in the own axes. All is expressed in axes half-way between the two.
    """
    (p, axes_p, _), (q, axes_q, _) = one, other
    frame, turn = np.eye(3), np.zeros(3)
    if direction is not None:
        u, v = axes_p[:, direction], axes_q[:, direction]
        v = v if u @ v >= 0 else -v
        normal = np.cross(u, v)
        sine = np.linalg.norm(normal)
        if sine > 0.0:
            turn = 2.0 * math.tan(0.5 * math.atan2(sine, u @ v)) * normal / sine
        frame[:, direction] = (u + v) / np.linalg.norm(u + v)
        second = axes_p[:, (direction + 1) % 3]
        second = second - (second @ frame[:, direction]) * frame[:, direction]
        frame[:, (direction + 1) % 3] = second / np.linalg.norm(second)
        frame[:, (direction + 2) % 3] = np.cross(
            frame[:, direction], frame[:, (direction + 1) % 3]
        )
    covariance = np.zeros((6, 6))
    for position, axes, own in (one, other):
        carried = np.zeros((6, 6))  # a rotation about the position moves the point half-way
        carried[:3, :3] = carried[3:, 3:] = frame.T @ axes
        carried[:3, 3:] = frame.T @ np.cross(axes.T, (p + q) / 2 - position).T
        covariance += carried @ own @ carried.T
    residual = np.concatenate([frame.T @ (q - p), frame.T @ turn])
    picked = list(determined)
    return residual[picked], covariance[np.ix_(picked, picked)]


def umeyama(points, targets, weights):
    """Rigid transform (4, 4) of weighted least squares from points to targets (Umeyama 1991)."""
    weights = weights / weights.sum()
    centre, target = weights @ points, weights @ targets
    u, _, vt = np.linalg.svd((targets - target).T @ (weights[:, None] * (points - centre)))
    transform = np.eye(4)
    transform[:3, :3] = u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt
    transform[:3, 3] = target - transform[:3, :3] @ centre
    return transform


class Representative:
    """The first point of a cell, and what is known of the others."""

    def __init__(self, serial, point, local, time_ns):
        self.serial, self.position, self.local = serial, point, local
        self.sight_ns, self.hits, self.total, self.mean = time_ns, 1, np.zeros(3), local


class Representatives:
    """The representatives of a stream, one point at a time; positions in the world frame."""

    def __init__(self, resolution, base, duration_ns):
        self.resolution, self.base, self.duration_ns = resolution, base, duration_ns
        self.cells, self.everyone, self.newest, self.serial = {}, [], None, 0

    def push(self, sweep, origin):
        """The representative of every point of a sweep, REJECTED (-2) or LATE (-3)."""
        result = []
        ranges = np.full(len(sweep), np.nan) if sweep.ranges is None else sweep.ranges
        for point, time_ns, distance in zip(sweep.points, sweep.times_ns, ranges, strict=True):
            result.append(self._one(point, int(time_ns), float(distance), origin))
            self.serial += 1
        return result

    def _one(self, point, time_ns, distance, origin):
        if not np.isfinite(point).all():
            return -2
        self.newest = time_ns if self.newest is None else max(self.newest, time_ns)
        if time_ns <= self.newest - self.duration_ns:
            return -3
        local = point - origin
        level = sum(distance > self.base * 2**k for k in range(3))
        cell = tuple(int(np.floor(x / self.resolution)) >> level for x in local)
        known = self.cells.get((level, cell))
        if known is None or known.sight_ns <= self.newest - self.duration_ns:
            known = Representative(self.serial, point, local, time_ns)
            self.cells[level, cell] = known
            self.everyone.append(known)
            return known
        known.sight_ns = max(known.sight_ns, time_ns)
        known.hits += 1
        if known.hits <= 16:
            known.total = known.total + (local - known.local)
        if known.hits in (2, 4, 8, 16):
            known.mean = known.local + known.total / known.hits
        return known

    def alive(self):
        """In the order of founding."""
        return [r for r in self.everyone if r.sight_ns > self.newest - self.duration_ns]

    def rows(self, representatives):
        """Rows in `alive` of the representatives that `push` returned."""
        row = {id(r): k for k, r in enumerate(self.alive())}
        return [r if isinstance(r, int) else row.get(id(r), -3) for r in representatives]
