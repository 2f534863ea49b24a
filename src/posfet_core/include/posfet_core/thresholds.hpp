// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// Thresholds of the taxels, with hysteresis.
///
/// A taxel enters a contact at the enter threshold and stays in it until its force falls below the release threshold;
/// both rise with the uncertainty of the force.
#pragma once

#include <vector>

#include "posfet_core/grid.hpp"

namespace posfet {

/// Standard deviations above zero from which a force begins a contact [1].
constexpr double kEnterDeviations = 5.0;

/// Standard deviations above zero below which a force ends a contact [1].
constexpr double kReleaseDeviations = 2.5;

/// A contact does not end by that rule while it keeps this share of its recent force [1]: a baseline drifts slowly, a
/// release removes the whole force at once.
constexpr double kHeldShare = 0.5;

/// Decay of the recent force [1] in `kRecentTime` [s], a block: 5 s.
constexpr double kRecentDecay = 0.996;
constexpr double kRecentTime = 0.02;

/// Share of a force that the film's hysteresis may leave after its release [1], assumed: less force is no contact.
constexpr double kResidualHysteresis = 0.02;

/// Fall of a force between two updates by which a contact that ended at a raised threshold is still being released
/// [contact threshold]; the error of an offset causes less.
constexpr double kReleasing = 0.1;

/// Thresholds of a taxel without uncertainty [N].
struct ContactThresholds {
  double enter;
  double release;
};

/// Which taxels are in contact, scan by scan.
class Thresholds {
public:
  Thresholds(Taxel taxels, ContactThresholds contact);

  /// Use other thresholds from the next `update` on.
  void set(ContactThresholds contact) { contact_ = contact; }

  /// Set the thresholds according to the uncertainty of the forces: `force` [N], `variance` of each [N2]. Taxels that
  /// are not `usable` may be in no contact; null: all are usable. `duration` has passed since the last update [s].
  void update(const double* force, const double* variance, const bool* usable, double duration);

  /// Apply the thresholds to the forces of a scan [N]; return whether the set of taxels in contact changed.
  bool apply(const double* force);

  /// Whether any of these forces [N] would be in contact.
  bool any(const double* force) const;

  /// Let forces [N] count as recent.
  void raise_recent(const double* force);

  /// Taxels in contact.
  const Mask& touched() const { return touched_; }

  /// Taxels in contact in any scan since the last update, or being released.
  const Mask& touched_since_update() const { return since_update_; }

  /// Force above which a taxel counts toward a region [N].
  double floor(Taxel taxel) const { return floor_[static_cast<std::size_t>(taxel)]; }

private:
  void choose_limits();

  ContactThresholds contact_;
  std::vector<double> enter_;
  std::vector<double> release_;
  std::vector<double> floor_;
  std::vector<double> limit_;   ///< The threshold of each taxel that is in force.
  std::vector<double> recent_;  ///< Greatest force of late.
  std::vector<double> before_;  ///< Force at the last update.
  Mask touched_;
  Mask next_;  ///< Of the scan that is being compared.
  Mask since_update_;
};

}  // namespace posfet
