"""Clipping of batches of convex polygons, compared with plain loops over one pair at a time."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dembrick.geometry import clipping, polygons


def plain_clip(subject, clipper):
    """Clip a convex polygon by another, edge by edge (Sutherland and Hodgman).

    Corners may repeat in either polygon. The result is empty if the polygons are apart, and may be a sliver or have
    repeated corners if they only touch: see :func:`simplify`.
    """
    x0, y0 = clipper[-1]
    for x1, y1 in clipper:
        ex, ey = x1 - x0, y1 - y0
        sides = [ex * (y - y0) - ey * (x - x0) for x, y in subject]
        if min(sides, default=0.0) < 0.0:
            kept = []
            (px, py), ps = subject[-1], sides[-1]
            for (x, y), side in zip(subject, sides, strict=True):
                if (side < 0.0) != (ps < 0.0):
                    t = ps / (ps - side)
                    kept.append((px + t * (x - px), py + t * (y - py)))
                if side >= 0.0:
                    kept.append((x, y))
                px, py, ps = x, y, side
            subject = kept
        if len(subject) < 3:
            return []
        x0, y0 = x1, y1
    return subject


def plain_simplify(points, tolerance):
    """Remove corners that repeat another or lie on the line of their neighbours, within ``tolerance``."""
    points = list(points)
    i = 0
    checked = 0  # consecutive corners that are kept
    while len(points) >= 3 and checked < len(points):
        i %= len(points)
        (px, py), (x, y), (qx, qy) = points[i - 1], points[i], points[(i + 1) % len(points)]
        chord = math.hypot(qx - px, qy - py)
        ux, uy = x - px, y - py
        double_area = abs(ux * (qy - py) - uy * (qx - px))
        if math.hypot(ux, uy) <= tolerance or double_area <= tolerance * chord:
            del points[i]
            i -= 2
            i %= max(len(points), 1)
            checked = 0
        else:
            i += 1
            checked += 1
    return points if len(points) >= 3 else []


def random_polygon(rng, n):
    angles = np.sort(rng.uniform(0.0, 2.0 * np.pi, n))
    return np.stack([np.cos(angles), np.sin(angles)], axis=1) @ rng.normal(size=(2, 2))


def counterclockwise(polygon):
    return polygon if polygons.area(polygon) > 0.0 else polygon[::-1]


def room_for(shapes, room):
    """Pad polygons to one array of ``room`` corners by repeating the last corner of each."""
    return np.array([np.concatenate([p, np.repeat(p[-1:], room - len(p), axis=0)]) for p in shapes])


@given(st.integers(0, 10_000))
@settings(max_examples=40, deadline=None)
def test_a_batch_is_clipped_as_one_pair_after_another(seed):
    rng = np.random.default_rng(seed)
    firsts = [counterclockwise(random_polygon(rng, int(rng.integers(3, 9)))) for _ in range(30)]
    seconds = [counterclockwise(random_polygon(rng, int(rng.integers(3, 7)))) + rng.normal(size=2) for _ in range(30)]
    points, count = clipping.simplify(*clipping.clip(room_for(firsts, 9), room_for(seconds, 7)), np.full(30, 1e-9))
    for k in range(30):
        twin = plain_clip([tuple(p) for p in firsts[k].tolist()], [tuple(p) for p in seconds[k].tolist()])
        twin = plain_simplify(twin, 1e-9)
        assert count[k] == len(twin)
        if twin:
            found = clipping.started_lowest(points[k : k + 1], count[k : k + 1], (0.8, 0.6))[0, : count[k]]
            start = int(np.argmin(np.array(twin) @ (0.8, 0.6)))
            assert found == pytest.approx(np.array(twin[start:] + twin[:start]), abs=1e-12)


@given(st.integers(0, 10_000))
@settings(max_examples=25, deadline=None)
def test_the_common_part_holds_exactly_the_common_points(seed):
    rng = np.random.default_rng(seed)
    first = counterclockwise(random_polygon(rng, 6))
    second = counterclockwise(random_polygon(rng, 9)) + rng.normal(size=2)

    def inside(polygon, points):
        edges = np.roll(polygon, -1, axis=0) - polygon
        offset = points[:, None] - polygon
        return (edges[:, 0] * offset[..., 1] - edges[:, 1] * offset[..., 0] >= 0.0).all(axis=1)

    both = [
        clipping.simplify(*clipping.clip(one[None], two[None]), np.array([1e-12]))
        for one, two in ((first, second), (second, first))
    ]
    (one, n), (two, m) = [(points[0, : count[0]], count[0]) for points, count in both]
    points = rng.uniform(first.min(axis=0), first.max(axis=0), size=(4000, 2))
    common = inside(first, points) & inside(second, points)
    if not n:
        assert not m and not common.any()
        return
    assert polygons.area(one) == pytest.approx(polygons.area(two), rel=1e-10, abs=1e-12)
    assert (inside(one, points) == common).all()


def test_simplify_drops_what_lies_on_a_line_and_nothing_else():
    tidy = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)]
    messy = [(0.0, 0.0), (0.5, 1e-12), (1.0, 0.0), (1.0, 1e-12), (1.0, 1.0), (0.3, 1.0), (0.0, 1.0), (0.0, 0.4)]
    batch = np.array([messy[start:] + messy[:start] for start in range(len(messy))])
    points, count = clipping.simplify(batch, np.full(len(messy), 8), np.full(len(messy), 1e-9))
    assert (count == 4).all()
    for kept in points[:, :4]:
        assert sorted(np.round(kept, 9).tolist()) == sorted(map(list, tidy))
    almost = np.array([[*tidy[:3], (0.5, 1.001), tidy[3]], [(0, 0), (1, 0), (2, 0), (9, 9), (9, 9)]], float)
    points, count = clipping.simplify(almost, np.array([5, 3]), np.full(2, 1e-9))
    assert count.tolist() == [5, 0] and (points[0] == almost[0]).all()
