// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// Separation of contacts so close to each other that they form one connected region.
///
/// Two fingertips two pitches apart have a saddle between them only while each is above a taxel of its own; after a
/// move by half a pitch, four taxels in a row read the same. So a region is *split* where it has peaks with a deep
/// enough saddle between them (saddle.hpp), and it *stays split* as long as the peaks, tracked from scan to scan, stay
/// apart: the force of each taxel is divided among them by a mixture of Gaussians of the skin's width, and the centres
/// are those of their parts (expectation-maximisation; A. P. Dempster et al., J. R. Stat. Soc. B 39, 1, 1977). Regions
/// that merge stay split, too, until they press hard enough for a saddle to be observable; then only if there is one.
#pragma once

#include <optional>

#include "posfet_core/footprint.hpp"
#include "posfet_core/grid.hpp"
#include "posfet_core/recycled.hpp"

namespace posfet {

/// Peaks closer to each other than this merge [pitch].
constexpr double kLeastDistance = 1.25;

/// Iterations from the peaks of a saddle to the centres of the contacts.
constexpr int kInitialIterations = 8;

/// Iterations from the centres of one scan to those of the next.
constexpr int kIterations = 2;

/// Share of each contact in each member of a region [1]; they sum up to 1 over the contacts.
using Shares = Vector<Vector<double>>;

/// Divides the forces of a region among its contacts.
class Mixture {
public:
  /// `spread` is that of the elastomer skin [m], `threshold` the contact threshold [N].
  Mixture(const Grid& grid, double spread, double threshold);

  /// Shares of contacts at the initial `positions` [m] in the forces of a region's members [N], >= 0, by
  /// expectation-maximisation; nothing where the contacts cannot be separated.
  std::optional<Shares> shares(const Vector<Point>& positions, const Taxels& members, const Vector<double>& weight,
                               int iterations) const;

private:
  /// One contact of the mixture.
  struct Component {
    double force = 0.0;  ///< [N].
    Point at;
  };

  Shares log_density(const Taxels& members, const Vector<Component>& components) const;
  Shares responsibilities(const Taxels& members, const Vector<Component>& components) const;
  Vector<Component> initial(const Vector<Point>& positions, const Taxels& members, const Vector<double>& weight) const;
  Vector<Component> updated(const Vector<Component>& components, const Taxels& members,
                            const Vector<double>& weight) const;
  void merge_close(Vector<Component>& components) const;

  const Grid& grid_;
  Point width_;  ///< Variance of a component along each axis [m2].
  double threshold_;
};

}  // namespace posfet
