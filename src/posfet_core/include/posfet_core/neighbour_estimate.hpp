// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// What the neighbours of a taxel predict for its force.
///
/// Pressure that has spread through the elastomer skin falls off like a Gaussian. On a grid along its axes a Gaussian
/// obeys f00 = f01*f10/f11 for every 2 x 2 square of taxels; one at an angle to it, as that of a bar, obeys
/// f00*f11 = f01*f10*exp(twist) with the same twist for all. The four squares around a taxel combined (mean of the
/// logarithms, weighted by the smallest force in each), with the twist of the squares next to them, come close for
/// other contacts too.
#pragma once

#include "posfet_core/grid.hpp"

namespace posfet {

/// Relative standard uncertainty of a force interpolated from neighbours that are far above the floor [1]: 0.11 for
/// spheres of 1.5 to 6 mm radius anywhere on a 5 x 5 array, the rest for 5 % gain mismatch.
constexpr double kInterpolationUncertainty = 0.2;

/// Smallest force of a square, over the floor, from which it shows the twist more than that there is none [1].
constexpr double kTwistForce = 10.0;

/// What limits an interpolation.
struct InterpolationLimits {
  double floor;   ///< Force from which a neighbour is informative [N]; smaller ones count as this one.
  double most_x;  ///< Greatest force over that of a neighbour along a row [1], by the elastomer skin; inf: no limit.
  double most_y;  ///< The same along a column [1].
};

/// A force as the neighbours of a taxel predict it.
struct NeighbourEstimate {
  double force;      ///< [N].
  double deviation;  ///< Standard uncertainty [N].
};

/// Force of a taxel as its neighbours predict it.
///
/// `force` are the forces of all taxels [N]; those of the `unknown` ones are not used. It is at most what the greatest
/// known neighbour in its row or column allows under a point load on the taxel. 0 where no known neighbour exceeds the
/// floor. NaN where every square of the taxel contains an unknown one or leaves the array.
///
/// Its variance is that of the interpolation, that of what its squares predict, which agree under a fingertip and not
/// under a ring, and what an error by the floor in each neighbour makes of it: in a corner whose square ends in an
/// untouched taxel it is more uncertain than it is large. Where it is limited, its uncertainty is the force itself.
NeighbourEstimate neighbour_interpolation(const Grid& grid, const double* force, const bool* unknown, Taxel taxel,
                                          const InterpolationLimits& limits);

/// The smallest force [N] that any square of a taxel predicts.
///
/// A square is informative when its other three taxels are known (`unknown` null: all are) and at least their `floor`
/// [N] (null: 0); negative forces count as 0. All squares that lie on the array have to be informative, so that a taxel
/// in a gap between two contacts is not expected to show a force: 0 where one is not, or where there is none.
double neighbour_lower_bound(const Grid& grid, const double* force, const bool* unknown, Taxel taxel,
                             const double* floor);

/// The largest of some values of all taxels among the eight neighbours of one; -inf where it has none.
double largest_neighbour(const Grid& grid, const double* values, Taxel taxel);

}  // namespace posfet
