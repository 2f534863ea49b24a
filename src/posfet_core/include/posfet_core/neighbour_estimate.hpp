// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// What the neighbours of a taxel predict for its force.
///
/// Pressure that has spread through the elastomer skin falls off like a Gaussian. On a grid along its axes a Gaussian
/// obeys f00 = f01*f10/f11 for every 2 x 2 square of taxels.
#pragma once

#include "posfet_core/grid.hpp"

namespace posfet {

/// The smallest force [N] that any 2 x 2 square of a taxel predicts from the `force` of all taxels [N], negative ones
/// as 0. All squares that lie on the array have to be known, so that a taxel in a gap between two contacts is not
/// expected to show a force: 0 where one is not, or where there is none.
double least_neighbour_estimate(const Grid& grid, const double* force, Taxel taxel);

}  // namespace posfet
