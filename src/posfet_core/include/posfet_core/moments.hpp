// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// Centre of pressure and principal axes of a sampled force distribution, extrapolated beyond the edge of the array.
///
/// Forces of cells are integrals, so their weighted mean is very near to the centre of pressure (0.01 mm for a
/// fingertip) as long as the whole contact lies on the array. At the edge it is biased: a 2 N fingertip centred on the
/// outermost column reads 0.57 mm too far inside. There the profile across the edge is extrapolated by the rule of a
/// Gaussian, s[k+1] = s[k]^2/s[k-1]*exp(-(pitch/width)^2).
#pragma once

#include <array>
#include <vector>

#include "posfet_core/footprint.hpp"
#include "posfet_core/grid.hpp"

namespace posfet {

/// A profile is truncated where its value at the edge is at least this share of its maximum [1].
constexpr double kTruncatedShare = 0.02;

/// Greatest number of extrapolated rows or columns beyond an edge.
constexpr int kMostBeyond = 3;

/// Iterations in which two truncated profiles extrapolate each other.
constexpr int kEdgeIterations = 3;

/// Curvature of a profile at its centre over that of its flank [1]: fitted to Hertz's sphere; 1 would be a Gaussian.
constexpr double kFlank = 0.7;

/// Principal axes of a distribution, each as long as one standard deviation [m].
struct Axes {
  Point major;  ///< With x >= 0.
  Point minor;  ///< 90 degrees counter-clockwise from the major one.
};

/// Moments of a distribution of forces.
struct Moments {
  double force = 0.0;  ///< Sum of the forces [N].
  Point centre;        ///< Centre of pressure [m], extrapolated beyond the edge.
  Axes axes;           ///< Of the forces on the array.
};

/// Principal axes of the variances xx and yy and the covariance xy [m2].
Axes principal_axes(double xx, double yy, double xy);

/// Moments of force distributions on one array.
class MomentFinder {
public:
  /// `spread` is that of the elastomer skin [m], the least width of a contact.
  MomentFinder(const Grid& grid, double spread);

  /// Moments of the forces of a footprint's members [N], with a positive sum.
  Moments of(const Footprint& footprint, const Vector<double>& weight);

private:
  /// Profile of the forces along one axis.
  struct Profile {
    double first = 0.0;      ///< Position of its first value [m].
    double pitch = 0.0;      ///< Distance of its values [m].
    double narrowest = 0.0;  ///< Least variance of a contact [m2].
    std::vector<double> values;
  };

  /// Mean [m] and variance [m2] of a profile.
  struct Spread {
    double mean;
    double variance;
  };

  /// Sums over a profile: of its values [N], and of their products with the place and its square [N].
  struct Sums {
    double total;
    double moment;
    double second;

    void extend(double value, double before, double beyond, double direction, double fall, double least);
  };

  void fill_profiles(const Footprint& footprint, const Vector<double>& weight);
  Point extrapolated_centre(Point mean, Point variance) const;

  const Grid& grid_;
  Profile along_x_;
  Profile along_y_;

  static bool is_truncated(const std::vector<double>& values);
  static Spread extrapolate(const Profile& profile, Spread inside, double curvature);
  static double curvature(const Profile& profile, double variance_across);
  static double flank_curvature(const Profile& profile);
};

}  // namespace posfet
