"""Where the search for a Gauss image of edge offsets starts: cones inside, carried to the rim."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import breadth_first_order

from pqmesh.koebe.edge_cones import EdgeCones, edge_cones
from pqmesh.mesh.quadmesh import PolyMesh
from pqmesh.vectors import TINY, Floats, Indices, cross, dot, norm, unit

# Factors on which the edges of a rim vertex agree to this share are one.
AGREEING = 1e-6


def start_image(mesh: PolyMesh) -> Floats:
    """Cones through the edges inside, carried on to the rim with the edges' factors, (V, 3)."""
    normals, (i, j) = mesh.vertex_normals, mesh.edges.T
    # Elsewhere the normals, long enough for edges of their length to touch the sphere.
    size = len(normals)
    turn = norm(normals[j] - normals[i])
    sums = np.bincount(i, turn, size) + np.bincount(j, turn, size)
    reach = 0.5 * sums / np.maximum(mesh.topology.valence, 1)
    image = normals * np.sqrt(1.0 + reach**2)[:, None]
    cones = edge_cones(mesh)
    image[cones.vertices] = _one_sided(mesh, cones)
    known = np.zeros(size, dtype=np.bool_)
    known[cones.vertices] = True
    triples = mesh.topology.straight_triples
    triples = np.concatenate([triples, triples[:, ::-1]])
    # Twice: the corners of a grid follow from its rim.
    for _ in range(2):
        a, b, c = triples[known[triples[:, :2]].all(axis=1) & ~known[triples[:, 2]]].T
        factor = _factors(mesh, image, a, b)
        straight = np.isin(np.arange(size), c)
        both = np.concatenate([mesh.edges, mesh.edges[:, ::-1]])
        near, far = both[known[both[:, 0]] & ~known[both[:, 1]] & ~straight[both[:, 1]]].T
        factor = np.concatenate([factor, _factors(mesh, image, near, far)])
        ends, places = _carried(
            mesh, image, np.concatenate([b, near]), np.concatenate([c, far]), factor
        )
        total, count = np.zeros((size, 3)), np.bincount(ends, minlength=size)
        np.add.at(total, ends, places)
        image[count > 0] = total[count > 0] / count[count > 0, None]
        known |= count > 0
    return image


def _one_sided(mesh: PolyMesh, cones: EdgeCones) -> Floats:
    """Vectors of the cones turned to one side of the image, that of most normals, (n, 3).

    Neighbours agree where their difference is the more nearly parallel to the edge. Normals alone
    would not do: at a fold of the mesh they change sides, and the image does not.
    """
    count, number = len(cones.vertices), np.full(mesh.topology.n_vertices, -1, dtype=np.int64)
    number[cones.vertices] = np.arange(count)
    inner = (number[mesh.edges] >= 0).all(axis=1)
    i, j = number[mesh.edges[inner]].T
    along, vectors = unit(mesh.edge_vectors)[inner], cones.vectors
    apart = norm(cross(vectors[i] - vectors[j], along))
    turned = norm(cross(vectors[i] + vectors[j], along)) < apart
    graph = coo_array((np.ones(len(i)), (i, j)), shape=(count, count)).tocsr()
    flips = {(a, b): -1.0 for a, b in zip(i[turned].tolist(), j[turned].tolist(), strict=True)}
    signs = np.zeros(count)
    for root in range(count):
        if signs[root] == 0.0:
            order, before = breadth_first_order(graph, root, directed=False)
            signs[root] = 1.0
            for vertex in order[1:].tolist():
                parent = int(before[vertex])
                flip = flips.get((parent, vertex), flips.get((vertex, parent), 1.0))
                signs[vertex] = signs[parent] * flip
            up = dot(vectors[order], mesh.vertex_normals[cones.vertices[order]])
            signs[order] *= 1.0 if float((signs[order] * up).sum()) >= 0.0 else -1.0
    return np.asarray(signs[:, None] * vectors)


def _factors(mesh: PolyMesh, image: Floats, a: Indices, b: Indices) -> Floats:
    """Length of the image's steps from a to b over the mesh's, signed."""
    step = mesh.vertices[b] - mesh.vertices[a]
    return np.asarray(dot(image[b] - image[a], step) / dot(step, step))


def _carried(
    mesh: PolyMesh, image: Floats, near: Indices, far: Indices, factor: Floats
) -> tuple[Indices, Floats]:
    """Vertices next to known ones, and where the image may have them.

    Along the edge from b to c the image goes to s_b + f (c - b), until another edge at c touches
    the sphere. Each gives two such f; one on which all agree is taken, and of several the one
    nearest in ratio to the expected factor: the others are often 0, a collapsed edge.
    """
    roots = _touching(mesh, image, near, far)
    pairs, size = roots.shape[0], roots.shape[1] * 2
    flat = roots.reshape(pairs, size)
    gaps = np.abs(flat[:, :, None, None] - roots[:, None])
    # Distance of each root from the nearest one of every other edge; padding counts for nothing.
    misfit = np.nan_to_num(gaps.min(axis=3), nan=0.0).max(axis=2)
    agreed = misfit <= AGREEING * np.nanmax(np.abs(flat), axis=1, keepdims=True)
    ratio = flat / np.where(factor == 0.0, 1.0, factor)[:, None]
    likeness = np.minimum(np.abs(ratio), 1.0 / np.where(ratio == 0.0, np.inf, np.abs(ratio)))
    score = np.where(ratio > 0.0, likeness, 0.5 * likeness) + 2.0 * agreed
    best = np.where(np.isnan(flat), -1.0, score).argmax(axis=1)
    step = mesh.vertices[far] - mesh.vertices[near]
    return far, image[near] + flat[np.arange(pairs), best][:, None] * step


def _touching(mesh: PolyMesh, image: Floats, near: Indices, far: Indices) -> Floats:
    """Factors at which the other edges at `far` touch the sphere, (n, k, 2), padded with nan."""
    tails, heads = np.concatenate([mesh.edges, mesh.edges[:, ::-1]]).T
    heads, valence = heads[np.argsort(tails, kind="stable")], mesh.topology.valence
    first = np.concatenate([[0], np.cumsum(valence)])
    place = np.arange(int(valence[far].max(initial=1)))
    there = place[None] < valence[far][:, None]
    other = heads[np.where(there, first[far][:, None] + place, 0)]
    there &= other != near[:, None]
    step = (mesh.vertices[far] - mesh.vertices[near])[:, None]
    side = unit(mesh.vertices[other] - mesh.vertices[far][:, None])
    start, along = cross(image[near][:, None], side), cross(step, side)
    square = np.maximum(dot(along, along), TINY)
    middle = -dot(start, along) / square
    half = np.sqrt(np.maximum(middle**2 - (dot(start, start) - 1.0) / square, 0.0))
    roots = np.stack([middle - half, middle + half], axis=2)
    return np.where(there[:, :, None], roots, np.nan)
