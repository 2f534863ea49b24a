# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Non-negative least squares with a given total: a dense, slow and exact reference for tests."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


def solve(matrix: FloatArray, given: FloatArray, total: float) -> FloatArray:
    """Return s >= 0 with sum(s) = total > 0 that minimises ``|matrix (s - given)|``.

    A primal active set (J. Nocedal, S. Wright, Numerical Optimization, 2006, algorithm 16.3), from the uniform s.
    """
    size = len(given)
    gram = matrix.T @ matrix
    solution = np.full(size, total / size)
    free = np.ones(size, np.bool_)
    for _ in range(100 * size):
        count = int(free.sum())
        system = np.zeros((count + 1, count + 1))
        system[:count, :count] = gram[np.ix_(free, free)]
        system[:count, count] = system[count, :count] = 1.0
        right = np.append(gram[free] @ (given - solution), 0.0)
        answer = np.linalg.solve(system, right)
        step = np.zeros(size)
        step[free] = answer[:count]
        falling = step < -1e-15
        reach = np.where(falling, solution / np.where(falling, -step, 1.0), np.inf)
        if reach.min() < 1.0:
            solution = np.maximum(solution + reach.min() * step, 0.0)
            free[reach.argmin()] = False
            solution[reach.argmin()] = 0.0
            continue
        solution = solution + step
        slope = gram @ (solution - given) + answer[count]
        slope[free] = 0.0
        if slope.min() >= -1e-12:
            return solution
        free[slope.argmin()] = True
    raise AssertionError("the active set did not converge")
