"""Crosstalk undone, held to the dense inverse."""

from __future__ import annotations

import numpy as np
import pytest

from posfet_model.crosstalk import CrosstalkInverse
from posfet_model.sensor import Layout


def mixing(layout: Layout, share: float) -> np.ndarray:
    """The dense matrix of what each taxel shows of all."""
    matrix = np.eye(layout.taxels)
    for taxel in range(layout.taxels):
        row, col = divmod(taxel, layout.cols)
        for r, c in ((row - 1, col), (row + 1, col), (row, col - 1), (row, col + 1)):
            if 0 <= r < layout.rows and 0 <= c < layout.cols:
                matrix[taxel, r * layout.cols + c] = share
    return matrix


@pytest.mark.parametrize(("rows", "cols"), [(1, 1), (1, 6), (5, 5), (4, 7), (16, 16)])
@pytest.mark.parametrize("share", [0.0, 0.01, 0.02, 0.05])
def test_it_is_the_inverse_to_the_order_that_is_claimed(rows: int, cols: int, share: float) -> None:
    layout = Layout(1, rows, cols, 1.5e-3, 1.5e-3, 1e-6)
    true = np.random.default_rng(1).normal(size=layout.taxels)
    undone = CrosstalkInverse(layout, share).apply(mixing(layout, share) @ true)
    np.testing.assert_allclose(undone, true, rtol=0, atol=(4 * share) ** 3 * np.abs(true).max() + 1e-12)


def test_the_share_has_a_range() -> None:
    with pytest.raises(ValueError, match="share"):
        CrosstalkInverse(Layout(1, 2, 2, 1e-3, 1e-3, 1e-6), 0.3)
