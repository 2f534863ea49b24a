// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_core/detection.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "posfet_core/numbers.hpp"

namespace posfet {

namespace {

/// A force counts as greater than another where it is by this much [1]: interpolation from two equal forces gives
/// theirs to the rounding.
constexpr double kGreater = 1.0 + 1e-9;

/// Greatest force of some taxels, at least one [N]; NaN when one is unknown.
double greatest(const double* force, const Taxels& taxels) {
  double found = force[taxels.front()];
  for (const Taxel taxel : taxels) {
    found = maximum(found, force[taxel]);
  }
  return found;
}

bool any(const bool* flags, const Taxels& taxels) {
  return flags != nullptr && std::any_of(taxels.begin(), taxels.end(), [&](Taxel taxel) { return flags[taxel]; });
}

bool all(const bool* flags, const Taxels& taxels) {
  return flags != nullptr && std::all_of(taxels.begin(), taxels.end(), [&](Taxel taxel) { return flags[taxel]; });
}

/// The number of the contact with the greatest share in each member; the first one of equal ones.
Vector<std::size_t> owners(const Shares& shares) {
  Vector<std::size_t> owner(shares.front().size(), 0);
  for (std::size_t member = 0; member < owner.size(); ++member) {
    for (std::size_t contact = 1; contact < shares.size(); ++contact) {
      owner[member] = shares[contact][member] > shares[owner[member]][member] ? contact : owner[member];
    }
  }
  return owner;
}

}  // namespace

ContactFinder::ContactFinder(const Layout& layout, double spread, ContactThresholds contact)
    : grid_(layout),
      thresholds_(grid_.taxels(), contact),
      moments_(grid_, spread),
      saddles_(grid_, spread, contact.enter),
      mixture_(grid_, spread, contact.enter) {}

std::size_t ContactFinder::find(const double* force) {
  if (thresholds_.apply(force)) {
    footprints_ = footprints(grid_, thresholds_.touched());
  }
  return footprints_.size();
}

Vector<Region> ContactFinder::measure(const ForceEstimate& taxels, const KnownRegions& before) {
  Vector<Region> found;
  patches_.clear();
  thresholds_.raise_recent(taxels.force);
  for (const Footprint& footprint : footprints_) {
    Taxels named = listed(footprint, taxels, before);
    if (!named.empty()) {
      patches_.push_back(footprint.members);
      measure_region(footprint, std::move(named), taxels, before, found);
    }
  }
  return found;
}

void ContactFinder::measure_region(const Footprint& footprint, Taxels listed, const ForceEstimate& taxels,
                                   const KnownRegions& before, Vector<Region>& found) {
  const Patch patch = this->patch(footprint, taxels);
  KnownRegions known;
  std::copy_if(before.begin(), before.end(), std::back_inserter(known),
               [&](const Region* region) { return intersect(region->touched, footprint.region); });
  Vector<Point> positions;
  std::transform(known.begin(), known.end(), std::back_inserter(positions),
                 [](const Region* region) { return region->centre_of_pressure; });
  int iterations = kIterations;
  bool separated = true;
  std::optional<Region> whole;
  if (known.size() < 2 ||
      !std::all_of(known.begin(), known.end(), [](const Region* each) { return each->separated; })) {
    whole = measure_part(patch, patch.weight, patch.highest, listed, footprint.region, false);
    Vector<Point> peaks = this->peaks(*whole, patch, known.size() > 1);
    separated = known.size() < 2 || peaks.size() >= known.size() || !is_unresolvable(known, patch);
    if (separated && peaks.size() != known.size()) {
      positions = std::move(peaks);
      iterations = kInitialIterations;
    }
  }
  std::optional<Shares> shares;
  if (positions.size() > 1) {
    shares = mixture_.shares(positions, footprint.members, patch.weight, iterations);
  }
  if (shares) {
    measure_parts(patch, *shares, listed, separated, found);
  } else if (whole) {
    found.push_back(std::move(*whole));
  } else {
    found.push_back(measure_part(patch, patch.weight, patch.highest, std::move(listed), footprint.region, false));
  }
}

ContactFinder::Patch ContactFinder::patch(const Footprint& footprint, const ForceEstimate& taxels) const {
  Vector<double> weight;
  weight.reserve(footprint.members.size());
  Taxels counted;
  counted.reserve(footprint.members.size());
  for (const Taxel taxel : footprint.members) {
    const double force = taxels.force[taxel];
    const bool counts = force > thresholds_.floor(taxel);
    weight.push_back(counts ? force : 0.0);
    if (counts) {
      counted.push_back(taxel);
    }
  }
  const double highest = greatest(taxels.force, footprint.members);
  const double variance = taxels.variance_of_sum(counted) + taxels.variance_of_rise(counted);
  return {footprint, std::move(weight), variance, highest, taxels};
}

/// The taxels that a region lists; none: it is no contact.
Taxels ContactFinder::listed(const Footprint& footprint, const ForceEstimate& taxels,
                             const KnownRegions& before) const {
  const Taxels& region = footprint.region;
  Taxels found;
  const auto may_be = [&](Taxel taxel) { return taxels.unlisted == nullptr || !taxels.unlisted[taxel]; };
  std::copy_if(region.begin(), region.end(), std::back_inserter(found), may_be);
  if (!found.empty() || all(taxels.interpolated, region)) {
    return found;
  }
  // Only a noisy taxel is above the threshold: its neighbours must respond to the touch, too (with hysteresis).
  const bool continues =
      std::any_of(before.begin(), before.end(), [&](const Region* each) { return intersect(each->touched, region); });
  const double share = continues ? kNeighbourRelease : 1.0;
  std::copy_if(footprint.members.begin(), footprint.members.end(), std::back_inserter(found),
               [&](Taxel taxel) { return may_be(taxel) && taxels.force[taxel] > share * thresholds_.floor(taxel); });
  return found;
}

/// Positions [m] of the peaks that saddles separate in a region; empty when it is one contact.
Vector<Point> ContactFinder::peaks(const Region& whole, const Patch& patch, bool were_apart) const {
  if (std::hypot(whole.axes.major.x, whole.axes.major.y) < saddles_.least_major_axis()) {
    return {};
  }
  return saddles_.peaks(patch.footprint, patch.taxels.force, patch.taxels.interpolated, were_apart);
}

/// Whether contacts that were separate regions may have a saddle, though none is observable.
bool ContactFinder::is_unresolvable(const KnownRegions& known, const Patch& patch) const {
  double weakest = known.front()->peak_pressure;
  for (const Region* region : known) {
    weakest = std::min(weakest, region->peak_pressure);
  }
  return weakest * grid_.layout().taxel_area < saddles_.resolvable_force() ||
         any(patch.taxels.interpolated, patch.footprint.region);
}

/// Measure the contacts of one region by their shares; each taxel is listed by the contact with most of it.
void ContactFinder::measure_parts(const Patch& patch, const Shares& shares, const Taxels& listed, bool separated,
                                  Vector<Region>& found) {
  const Vector<std::size_t> owner = owners(shares);
  const Taxels& members = patch.footprint.members;
  for (std::size_t contact = 0; contact < shares.size(); ++contact) {
    Taxels owned;
    Vector<double> weight(members.size());
    for (std::size_t member = 0; member < members.size(); ++member) {
      weight[member] = shares[contact][member] * patch.weight[member];
      if (owner[member] == contact) {
        owned.push_back(members[member]);
      }
    }
    Taxels named;
    std::set_intersection(owned.begin(), owned.end(), listed.begin(), listed.end(), std::back_inserter(named));
    if (!named.empty()) {
      const double highest = greatest(patch.taxels.force, owned);
      found.push_back(measure_part(patch, weight, highest, named, named, separated));
    }
  }
}

/// Measure a contact by its part of the members' forces [N]; `listed` are the taxels that it lists, `touched` all of
/// its taxels.
Region ContactFinder::measure_part(const Patch& patch, const Vector<double>& weight, double highest, Taxels listed,
                                   Taxels touched, bool separated) {
  Outline shape = outline(grid_, std::move(listed));
  const double peak = greatest(patch.taxels.force, shape.taxels);
  const bool bounded = any(patch.taxels.saturated, shape.taxels);
  const Moments moments = moments_.of(patch.footprint, weight);
  Region region;
  region.touched = std::move(touched);
  region.centre_of_pressure = moments.centre;
  region.geometric_centre = shape.centre;
  region.force = std::isnan(highest) ? kUnknown : moments.force;
  region.force_variance = bounded || std::isnan(region.force) ? kUnknown : patch.variance;
  region.area = shape.area;
  region.peak_pressure = bounded || highest > kGreater * peak ? kUnknown : peak / grid_.layout().taxel_area;
  region.axes = moments.axes;
  region.separated = separated;
  region.taxels = std::move(shape.taxels);
  return region;
}

}  // namespace posfet
