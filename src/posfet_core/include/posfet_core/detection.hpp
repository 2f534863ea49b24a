// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// Contact detection: regions of the force map above a threshold, with centre of pressure, force and shape.
///
/// One more ring of taxels around a contact counts toward force and moments, without being listed: the threshold would
/// otherwise truncate the contact's flanks asymmetrically.
#pragma once

#include <optional>

#include "posfet_core/contact.hpp"
#include "posfet_core/footprint.hpp"
#include "posfet_core/force_estimate.hpp"
#include "posfet_core/moments.hpp"
#include "posfet_core/recycled.hpp"
#include "posfet_core/saddle.hpp"
#include "posfet_core/separation.hpp"
#include "posfet_core/thresholds.hpp"

namespace posfet {

/// Release threshold over enter threshold of the neighbours of a noisy taxel [1].
constexpr double kNeighbourRelease = 0.5;

/// Regions of the scan before.
using KnownRegions = Vector<const Region*>;

/// Detects contacts scan by scan, with hysteresis.
class ContactFinder {
public:
  /// `spread` is that of the elastomer skin [m].
  ContactFinder(const Layout& layout, double spread, ContactThresholds contact);

  ContactFinder(const ContactFinder&) = delete;
  ContactFinder& operator=(const ContactFinder&) = delete;

  const Grid& grid() const { return grid_; }
  Thresholds& thresholds() { return thresholds_; }
  const Thresholds& thresholds() const { return thresholds_; }

  /// Find the regions in contact in the forces of a scan [N]; return their number.
  std::size_t find(const double* force);

  /// Measure the regions that `find` found, and separate contacts that share one. A region is split when it contains
  /// several contacts of the scan `before` that were separated, or when it has a saddle now.
  Vector<Region> measure(const ForceEstimate& taxels, const KnownRegions& before);

  /// The regions that `find` found last.
  const Vector<Footprint>& regions() const { return footprints_; }

  /// Members of each region that `measure` took for a contact, the ring around it included.
  const Vector<Taxels>& patches() const { return patches_; }

private:
  /// A region in one scan.
  struct Patch {
    const Footprint& footprint;
    Vector<double> weight;  ///< Force of each member that counts [N].
    double variance;        ///< Variance of their sum [N2].
    double highest;         ///< Greatest force of a member [N]; NaN when one is unknown.
    const ForceEstimate& taxels;
  };

  void measure_region(const Footprint& footprint, Taxels listed, const ForceEstimate& taxels,
                      const KnownRegions& before, Vector<Region>& found);
  Patch patch(const Footprint& footprint, const ForceEstimate& taxels) const;
  Taxels listed(const Footprint& footprint, const ForceEstimate& taxels, const KnownRegions& before) const;
  Vector<Point> peaks(const Region& whole, const Patch& patch, bool were_apart) const;
  bool is_unresolvable(const KnownRegions& known, const Patch& patch) const;
  void measure_parts(const Patch& patch, const Shares& shares, const Taxels& listed, bool separated,
                     Vector<Region>& found);
  Region measure_part(const Patch& patch, const Vector<double>& weight, double highest, Taxels listed, Taxels touched,
                      bool separated);

  Grid grid_;
  Thresholds thresholds_;
  MomentFinder moments_;
  SaddleFinder saddles_;
  Mixture mixture_;
  Vector<Footprint> footprints_;
  Vector<Taxels> patches_;
};

}  // namespace posfet
