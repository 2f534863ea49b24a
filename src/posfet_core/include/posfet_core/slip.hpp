// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// Dynamic (high-pass) channel: vibration of each taxel, and slip detection for each contact.
///
/// The change of force from scan to scan passes a first-order high-pass filter, which removes errors of the baseline.
///
/// A contact slips when its centre moves faster than a hand would move it. With y the high-passed force of a taxel at
/// x, a centre c and time constant T of the high-pass, a force distribution F that moves at v gives
/// sum((x - c)*y) = F*v*T. A press or a vibration changes F, but hardly its shape: then the same sum is negligible
/// compared with sum(y).
#pragma once

#include <vector>

#include "posfet_core/contact.hpp"
#include "posfet_core/grid.hpp"
#include "posfet_core/recycled.hpp"

namespace posfet {

/// Corner frequency of the high-pass [Hz].
constexpr double kCornerFrequency = 50.0;

/// Time constant of the average of a vibration's power [s].
constexpr double kPowerTimeConstant = 0.01;

/// A contact slips from this speed on [m/s], assumed.
constexpr double kSlipSpeed = 10e-3;

/// A slip ends below this speed [m/s], assumed.
constexpr double kSlipEndSpeed = 5e-3;

/// Time below that speed after which a slip ends [s].
constexpr double kSlipEndTime = 0.01;

/// Standard deviations of the noise below which nothing counts as slip [1].
constexpr double kSlipNoiseDeviations = 6.0;

/// Least distance between the centre of the changing force and that of the contact [pitch]: a press changes the force
/// about the contact's centre.
constexpr double kLever = 0.5;

/// A contact whose high-passed force exceeds this share of its force is in onset or release, and does not slip [1].
constexpr double kOnsetShare = 0.15;

/// Vibration and slip state of one contact.
struct Motion {
  double power = 0.0;     ///< Mean square of its high-passed force [N2].
  bool slipping = false;  ///< Whether the contact slips.
  double still = 0.0;     ///< Time below the end speed of a slip [s].
};

/// State of each contact that is not released, by its id.
using Motions = Map<TrackId, Motion>;

/// High-passed force of every taxel, updated by `advance` for each scan; restarts after a `pause`.
class DynamicChannel {
public:
  /// `noise` is the standard deviation of a reading [N].
  DynamicChannel(const Layout& layout, double noise);

  Taxel taxels() const { return grid_.taxels(); }

  /// Stop the filter: the scans from here on are not passed to `advance`.
  void pause();

  /// Filter the force changes of a scan since the one before, `step` seconds ago [N]; the first call after a pause only
  /// starts the filter.
  void advance(const double* change, double step);

  /// Update the mean square of each taxel's high-passed force over a step [s].
  void update_power(double step);

  /// Update vibration and slip of the contacts of a scan with the forces of all taxels [N].
  const Motions& update(const Vector<Contact>& contacts, const double* force, double step);

  /// What `update` found last.
  const Motions& motions() const { return motions_; }

  /// High-passed force of each taxel [N].
  const std::vector<double>& high_passed() const { return high_passed_; }

  /// Mean square of each taxel's high-passed force [N2], as `update_power` updated it.
  const std::vector<double>& power() const { return power_; }

private:
  void update_motion(Motion& motion, const Region& region, const double* force, double step) const;
  double noise_moment(const Region& region) const;

  Grid grid_;
  double lever_;  ///< [m].
  double noise_;
  bool running_ = false;
  std::vector<double> high_passed_;
  std::vector<double> power_;
  Motions motions_;
};

}  // namespace posfet
