"""The measures of a mesh at 50 digits, one face or one vertex at a time.

Written from the definitions, not from the package: plain loops over plain arrays, other
formulas where there are any. Every function takes doubles (exact as they are) and returns
mpmath numbers.
"""

from __future__ import annotations

from mpmath import mp, mpf

DIGITS = 50


def rows(points):
    """Array of doubles (k, 3) as lists of exact mpmath numbers."""
    return [[mpf(float(x)) for x in point] for point in points]


def minus(a, b):
    return [x - y for x, y in zip(a, b, strict=True)]


def inner(a, b):
    return sum((x * y for x, y in zip(a, b, strict=True)), mpf(0))


def outer(a, b):
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def length(a):
    return mp.sqrt(inner(a, a))


def between(a, b):
    """Angle of two vectors by the cosine: 50 digits leave 25 near 0."""
    cosine = inner(a, b) / (length(a) * length(b))
    return mp.acos(max(mpf(-1), min(mpf(1), cosine)))


# --- faces ------------------------------------------------------------------------------------


def planarity_deviation(corners):
    """Distance of the two lines through opposite corners, from the points nearest each other."""
    with mp.workdps(DIGITS):
        a, b, c, d = rows(corners)
        p, q, r = minus(c, a), minus(d, b), minus(b, a)
        # Smallest |a + s p - b - t q|: normal equations in s and t, by Cramer's rule.
        pp, pq, qq, pr, qr = inner(p, p), inner(p, q), inner(q, q), inner(p, r), inner(q, r)
        det = pp * qq - pq * pq
        s, t = (pr * qq - pq * qr) / det, (pr * pq - pp * qr) / det
        return length([s * x - t * y - z for x, y, z in zip(p, q, r, strict=True)])


def mean_diagonal(corners):
    """Mean length of the diagonals."""
    with mp.workdps(DIGITS):
        a, b, c, d = rows(corners)
        return (length(minus(c, a)) + length(minus(d, b))) / 2


def circularity_defect(corners):
    """Alternating sum of the four corner angles."""
    with mp.workdps(DIGITS):
        p = rows(corners)
        angles = [between(minus(p[i - 1], p[i]), minus(p[(i + 1) % 4], p[i])) for i in range(4)]
        return angles[0] - angles[1] + angles[2] - angles[3]


def circle_deviation(corners):
    """Ptolemy's inequality: what the sides' products exceed the diagonals' by, relative."""
    with mp.workdps(DIGITS):
        a, b, c, d = rows(corners)
        ac, bd = length(minus(c, a)), length(minus(d, b))
        one = length(minus(b, a)) * length(minus(d, c))
        two = length(minus(c, b)) * length(minus(a, d))
        return (one + two - ac * bd) / (ac * bd)


def face_normal(corners):
    """Unit vector area of a polygon, from its triangles about the first corner."""
    with mp.workdps(DIGITS):
        p = rows(corners)
        total = [mpf(0)] * 3
        for i in range(1, len(p) - 1):
            part = outer(minus(p[i], p[0]), minus(p[i + 1], p[0]))
            total = [x + y for x, y in zip(total, part, strict=True)]
        size = length(total)
        return [x / size for x in total]


# --- vertices ---------------------------------------------------------------------------------


def balance(center, neighbors):
    """w1 - w2 + w3 - ... of the angles between consecutive edges, in order around a vertex."""
    with mp.workdps(DIGITS):
        (v,) = rows([center])
        spokes = [minus(p, v) for p in rows(neighbors)]
        k = len(spokes)
        return sum(((-1) ** i * between(spokes[i], spokes[(i + 1) % k]) for i in range(k)), mpf(0))


def cone(faces):
    """Best common cone of the faces at a vertex: (w, misfit, spread, theta).

    `faces` is a list of corner arrays (k, 3). w solves the normal equations of n_f . w = 1
    exactly, so the normals must span space; misfit is max |n_f . w - 1|, spread and theta
    are the range and the largest of the angles between w and the normals.
    """
    with mp.workdps(DIGITS):
        normals = [face_normal(face) for face in faces]
        gram = mp.matrix(3, 3)
        right = mp.matrix(3, 1)
        for n in normals:
            for i in range(3):
                right[i] += n[i]
                for j in range(3):
                    gram[i, j] += n[i] * n[j]
        w = list(mp.lu_solve(gram, right))
        misfit = max(abs(inner(n, w) - 1) for n in normals)
        tilts = [between(n, w) for n in normals]
        return w, misfit, max(tilts) - min(tilts), max(tilts)
