"""Cholesky factors of sparse matrices with a narrow envelope."""

from dataclasses import dataclass

import numpy as np

_BLOCK = 64


@dataclass(frozen=True)
class Factor:
    """Lower factor, rows from their first non-zero column to the diagonal."""

    entry_start: np.ndarray
    """First entry of each row, shape (V,)."""
    column_start: np.ndarray
    """First column of each row, shape (V,)."""
    entries: np.ndarray
    """Values of all rows; the last of a row is one over the diagonal's."""
    inverse: np.ndarray
    """Dense inverse of the matrix, shape (V, V)."""


def order_rows(tets: np.ndarray, vertex_count: int) -> np.ndarray:
    """Order vertices so that joined ones are near each other (Cuthill and McKee, reversed).

    Args:
        tets: Vertex indices, shape (T, 4).
        vertex_count: V.

    Returns:
        Vertex of each row, shape (V,).
    """
    joined: list[set[int]] = [set() for _ in range(vertex_count)]
    for tet in tets.tolist():
        for i in tet:
            joined[i].update(tet)
    degree = [len(j) for j in joined]
    neighbours = [sorted(j - {i}, key=lambda v: (degree[v], v)) for i, j in enumerate(joined)]

    def walk(start: int) -> list[int]:
        queue, seen = [start], {start}
        for i in queue:
            new = [j for j in neighbours[i] if j not in seen]
            seen.update(new)
            queue += new
        return queue

    order: list[int] = []
    left = dict.fromkeys(range(vertex_count))
    while left:
        # from one end of the part: the last of a walk is far from where the walk began
        part = walk(walk(walk(next(iter(left)))[-1])[-1])
        order += part
        for i in part:
            del left[i]
    return np.array(order[::-1], dtype=np.int64)


def factorise(
    diagonal: np.ndarray, rows: np.ndarray, columns: np.ndarray, values: np.ndarray
) -> Factor:
    """Factorise a symmetric positive definite matrix in blocks within its envelope.

    Args:
        diagonal: Added to the diagonal, shape (V,).
        rows: Of each other term, both triangles, shape (N,).
        columns: Of each other term.
        values: Terms; those of one place are added.

    Returns:
        The factor in single precision, computed in double.
    """
    n = len(diagonal)
    column_start = np.arange(n)
    np.minimum.at(column_start, rows, columns)
    count = -(-n // _BLOCK)
    low = [int(column_start[i * _BLOCK : (i + 1) * _BLOCK].min()) // _BLOCK for i in range(count)]
    blocks = {
        (i, j): np.zeros((_BLOCK, _BLOCK)) for i in range(count) for j in range(low[i], i + 1)
    }
    is_lower = rows >= columns
    rows, columns, values = rows[is_lower], columns[is_lower], values[is_lower]
    key = (rows // _BLOCK) * count + columns // _BLOCK
    order = np.argsort(key, kind="stable")
    ends = np.flatnonzero(np.diff(key[order])) + 1
    for part in np.split(order, ends):
        if len(part):
            i, j = divmod(int(key[part[0]]), count)
            np.add.at(blocks[i, j], (rows[part] % _BLOCK, columns[part] % _BLOCK), values[part])
    padded = np.ones(count * _BLOCK)
    padded[:n] = diagonal
    for i in range(count):
        blocks[i, i] += np.diag(padded[i * _BLOCK : (i + 1) * _BLOCK])
        for j in range(low[i], i + 1):
            a = blocks[i, j]
            for k in range(max(low[i], low[j]), j):
                a -= blocks[i, k] @ blocks[j, k].T
            if j < i:
                blocks[i, j] = np.linalg.solve(blocks[j, j], a.T).T
            else:
                lower = np.tril(a)
                blocks[i, i] = np.linalg.cholesky(lower + np.tril(lower, -1).T)
    length = np.arange(n) - column_start + 1
    entry_start = np.cumsum(length) - length
    entries = np.empty(length.sum(), dtype=np.float32)
    for r in range(n):
        i = r // _BLOCK
        row = np.concatenate([blocks[i, j][r % _BLOCK] for j in range(low[i], i + 1)])
        at = slice(column_start[r] - low[i] * _BLOCK, r + 1 - low[i] * _BLOCK)
        values_of_row = row[at].copy()
        values_of_row[-1] = 1.0 / values_of_row[-1]
        entries[entry_start[r] : entry_start[r] + length[r]] = values_of_row
    lower = np.zeros((n, n))
    for (i, j), block in blocks.items():
        part = lower[i * _BLOCK : (i + 1) * _BLOCK, j * _BLOCK : (j + 1) * _BLOCK]
        part[:] = block[: part.shape[0], : part.shape[1]]
    inverse_lower = np.linalg.inv(lower)
    return Factor(
        entry_start=entry_start,
        column_start=column_start,
        entries=entries,
        inverse=(inverse_lower.T @ inverse_lower).astype(np.float32),
    )
