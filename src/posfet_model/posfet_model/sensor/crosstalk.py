# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Compensation of electrical crosstalk: each taxel picks up a share of the signals of its four neighbours.

With a share c of each neighbour the signals are ``x = s + c*N s``, N the sum over the four neighbours. On a grid N
separates into its two axes and is diagonalised by sines (discrete sine transform): the mode (j, k) of rows and columns
has the gain ``1 + 2*c*(cos(pi*j/(rows + 1)) + cos(pi*k/(cols + 1)))``. The inverse is therefore one small matrix on
either side of the map, which is exact. It is regularised by a limit on the gain: no mode is amplified more than twice,
which shares up to 1/8 never reach. It is applied to the signals before leakage compensation, where it is linear
whatever their sign.

The inverse does not know that the forces of a contact are not negative. `reconstruction.force_image.non_negative`
enforces it afterwards, only on the taxels of a contact, and keeps their sum. The pressure spread by the elastomer skin
is not crosstalk in this sense: it is part of the force on a taxel's cell.

Compiled: `posfet_core`, crosstalk.hpp.
"""

from __future__ import annotations

from posfet_core import scan_path
from posfet_model._lib.validation import real_number
from posfet_model.sensor.description import Layout
from posfet_model.sensor.grid import compiled_layout


class CrosstalkCompensator(scan_path.CrosstalkCompensator):
    """Compensates the crosstalk of one array.

    `apply` returns the signals with the crosstalk compensated, in their unit, shape [rows * cols]; `present` is whether
    there is any.

    Parameters
    ----------
    layout : Layout
        The array.
    share : float
        Share c of each of the four neighbours that a taxel picks up [1], in [0, 0.2].

    Raises
    ------
    ValueError
        The share is out of range.
    """

    def __init__(self, layout: Layout, share: float) -> None:
        super().__init__(compiled_layout(layout), real_number("share", share, 0.0, 0.2))
