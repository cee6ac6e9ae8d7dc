"""A bounding volume hierarchy over triangles: which of 100 000 faces can a quadrilateral meet, in microseconds.

Nodes are stored depth first: the first child of node i is node i + 1, and ``links[i, 0]`` is the node that follows its
whole subtree. A traversal needs no stack: it goes on to the next node if it hits one, and to that one if it misses.
This module imports numba, so it is imported when a mesh is cut for the first time.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...base.compiling import kernel, part

__all__ = ["Bvh", "build"]

LEAF = 8  # faces that are cheaper to try than to divide
BINS = 16
DEEPEST = 40  # levels after which halves are taken by number, so that no mesh makes a list of the tree
STACK = 2 * (DEEPEST + 32)


class Bvh(NamedTuple):
    """The tree.

    ``boxes`` are (n, 6) lowest and highest coordinates of each node. ``links`` are (n + 1, 2): the node after the
    subtree, which for a leaf is the next one; and the first face of the node in ``faces``, whose last face is the one
    before the first of that next node. ``faces`` holds every face once: a face with the same three vertices as an
    earlier one is left out, and one that names a vertex twice too.
    """

    boxes: NDArray[np.float64]
    links: NDArray[np.int32]
    faces: NDArray[np.int64]


def build(vertices: NDArray[np.float64], faces: NDArray[np.int64]) -> Bvh:
    """The tree of (f, 3) faces of (v, 3) vertices, by the surface area heuristic in bins."""
    order = _proper(faces, len(vertices))
    boxes, links = np.empty((2 * len(order), 6)), np.empty((2 * len(order) + 1, 2), dtype=np.int32)
    used = _grow(vertices, faces, order, boxes, links)
    for whole in (boxes, links, order):
        whole.setflags(write=False)
    return Bvh(boxes[:used], links[: used + 1], order)


def _proper(faces: NDArray[np.int64], vertices: int) -> NDArray[np.int64]:
    """The faces that name three vertices, of those with the same three the first."""
    a, b, c = np.sort(faces, axis=1).T
    candidates = np.flatnonzero((a < b) & (b < c))
    pairs = (a * vertices + b)[candidates]
    order = np.lexsort((c[candidates], pairs))  # stable: of equal faces the first comes first
    third = c[candidates][order]
    fresh = np.ones(len(order), dtype=np.bool_)
    fresh[1:] = (np.diff(pairs[order]) != 0) | (np.diff(third) != 0)
    return np.sort(candidates[order[fresh]])


@part
def _half_area(x: float, y: float, z: float) -> float:
    return x * y + y * z + z * x


@part
def _cheapest(amount: Any, bins: Any, area: Any) -> int:
    """The last bin of the first half, so that the sum of faces times area of both halves is least."""
    box = np.empty(6)
    box[:3], box[3:] = np.inf, -np.inf
    after = 0
    for i in range(BINS - 1, 0, -1):
        after += amount[i]
        for k in range(3):
            box[k], box[k + 3] = min(box[k], bins[i, k]), max(box[k + 3], bins[i, k + 3])
        area[i] = after * _half_area(box[3] - box[0], box[4] - box[1], box[5] - box[2]) if after > 0 else 0.0
    box[:3], box[3:] = np.inf, -np.inf
    before, best, cost = 0, 0, np.inf
    for i in range(BINS - 1):
        before += amount[i]
        for k in range(3):
            box[k], box[k + 3] = min(box[k], bins[i, k]), max(box[k + 3], bins[i, k + 3])
        here = before * _half_area(box[3] - box[0], box[4] - box[1], box[5] - box[2]) if before > 0 else 0.0
        if here + area[i + 1] < cost:
            best, cost = i, here + area[i + 1]
    return best


@kernel
def _grow(vertices: Any, faces: Any, order: Any, boxes: Any, links: Any) -> int:
    """Write the tree into its arrays, and ``order`` anew. Returns the number of nodes."""
    total = len(order)
    low, high = np.empty((len(faces), 3)), np.empty((len(faces), 3))
    for i in range(total):
        f = order[i]
        for k in range(3):
            a, b, c = vertices[faces[f, 0], k], vertices[faces[f, 1], k], vertices[faces[f, 2], k]
            low[f, k], high[f, k] = min(a, b, c), max(a, b, c)
    stack = np.empty((STACK, 3), dtype=np.int64)
    stack[0, 0], stack[0, 1], stack[0, 2] = 0, total, 0
    waiting, used = 1 if total > 0 else 0, 0
    amount, area = np.empty(BINS, dtype=np.int64), np.empty(BINS)
    bins = np.empty((BINS, 6))
    while waiting > 0:
        waiting -= 1
        begin, end, depth = stack[waiting]
        box = boxes[used]
        least, most = np.full(3, np.inf), np.full(3, -np.inf)  # of twice the middles
        box[:3], box[3:] = np.inf, -np.inf
        for i in range(begin, end):
            f = order[i]
            for k in range(3):
                box[k], box[k + 3] = min(box[k], low[f, k]), max(box[k + 3], high[f, k])
                middle = low[f, k] + high[f, k]
                least[k], most[k] = min(least[k], middle), max(most[k], middle)
        links[used, 0], links[used, 1] = 0, begin
        used += 1
        if end - begin <= LEAF:
            links[used - 1, 0] = used
            continue
        axis = np.argmax(most - least)
        divide = (begin + end) // 2
        extent = most[axis] - least[axis]
        if extent > 0 and depth < DEEPEST:
            amount[:] = 0
            bins[:, :3], bins[:, 3:] = np.inf, -np.inf
            scale = BINS * (1 - 1e-9) / extent
            for i in range(begin, end):
                f = order[i]
                into = min(max(int((low[f, axis] + high[f, axis] - least[axis]) * scale), 0), BINS - 1)
                amount[into] += 1
                for k in range(3):
                    bins[into, k] = min(bins[into, k], low[f, k])
                    bins[into, k + 3] = max(bins[into, k + 3], high[f, k])
            chosen = _cheapest(amount, bins, area)
            left, right = begin, end - 1
            while left <= right:
                f = order[left]
                into = min(max(int((low[f, axis] + high[f, axis] - least[axis]) * scale), 0), BINS - 1)
                if into <= chosen:
                    left += 1
                else:
                    order[left], order[right] = order[right], f
                    right -= 1
            if begin < left < end:
                divide = left
        stack[waiting, 0], stack[waiting, 1], stack[waiting, 2] = divide, end, depth + 1
        stack[waiting + 1, 0], stack[waiting + 1, 1], stack[waiting + 1, 2] = begin, divide, depth + 1
        waiting += 2
    for node in range(used - 1, -1, -1):
        if links[node, 0] == 0:  # no leaf: after its second child, which is after its first
            links[node, 0] = links[links[node + 1, 0], 0]
    links[used, 0], links[used, 1] = used, total
    return used
