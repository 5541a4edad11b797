"""The best of all ways to give rows a column each; the assignment asks."""

import numpy as np
from numpy.typing import NDArray

from distloc.types import FloatArray


def best_pairs(scores: FloatArray, by_row: NDArray[np.intp], by_column: NDArray[np.intp]) -> list[int]:
    """Which of the pairs (p,) of rows and columns make the largest sum of scores, each row and column once at most.

    Pairs that score nothing are left out. What stands alone is taken at once, the rest is solved exactly.
    """
    able = np.flatnonzero(scores > 0.0)
    if able.size == 0:
        return []
    rows, columns = by_row[able], by_column[able]
    is_alone = (np.bincount(rows)[rows] == 1) & (np.bincount(columns)[columns] == 1)
    found: list[int] = able[is_alone].tolist()
    rest = able[~is_alone]
    if rest.size == 0:
        return found
    row_names, row = np.unique(by_row[rest], return_inverse=True)
    column_names, column = np.unique(by_column[rest], return_inverse=True)
    # a column more for each row: it may have none
    table = np.zeros((row_names.size, column_names.size + row_names.size))
    index = np.full(table.shape, -1, np.intp)
    table[row, column], index[row, column] = scores[rest], rest
    chosen = index[np.arange(row_names.size), _columns_of(table.max() - table)]
    found += chosen[chosen >= 0].tolist()
    return found


def _columns_of(costs: FloatArray) -> NDArray[np.intp]:
    """The column (n,) of each row of costs (n, m >= n) where the sum is least: by shortest augmenting paths."""
    rows, columns = costs.shape
    of_row, of_column = np.zeros(rows), np.zeros(columns + 1)  # the duals; the last column is where a path begins
    holder = np.full(columns + 1, -1, np.intp)
    for row in range(rows):
        holder[-1], at = row, columns
        least, before = np.full(columns, np.inf), np.full(columns, columns, np.intp)
        is_used = np.zeros(columns + 1, np.bool_)
        while holder[at] >= 0:
            is_used[at] = True
            slack = costs[holder[at]] - of_row[holder[at]] - of_column[:-1]
            is_less = (slack < least) & ~is_used[:-1]
            least[is_less], before[is_less] = slack[is_less], at
            nearest = int(np.where(is_used[:-1], np.inf, least).argmin())
            step = least[nearest]
            of_row[holder[is_used]] += step
            of_column[is_used] -= step
            least[~is_used[:-1]] -= step
            at = nearest
        while at != columns:
            holder[at] = holder[before[at]]
            at = int(before[at])
        holder[-1] = -1
    found = np.zeros(rows, np.intp)
    held = np.flatnonzero(holder[:-1] >= 0)
    found[holder[held]] = held
    return found
