// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// One scan in one call: from the counts of the ADC to forces and contacts, without an interpreter.
///
/// counts -> charge and saturation -> plausibility -> burst -> offset, crosstalk -> mains hum -> inverse of the leakage
/// and sums of the block -> uniform changes -> history for the tests of the taxels -> thresholds -> regions ->
/// contacts -> tracking -> vibration and slip. What is estimated at the end of a block (20 ms) is set in the parts,
/// which are shared (block_end.hpp), and not while another thread processes a scan.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "posfet_core/bursts.hpp"
#include "posfet_core/count_history.hpp"
#include "posfet_core/crosstalk.hpp"
#include "posfet_core/detection.hpp"
#include "posfet_core/flags.hpp"
#include "posfet_core/force_estimate.hpp"
#include "posfet_core/force_integration.hpp"
#include "posfet_core/hum_filter.hpp"
#include "posfet_core/inverse_signal_chain.hpp"
#include "posfet_core/neighbour_estimate.hpp"
#include "posfet_core/scan.hpp"
#include "posfet_core/scan_clock.hpp"
#include "posfet_core/slip.hpp"
#include "posfet_core/tracker.hpp"

namespace posfet {

/// Number of consecutive scans with most taxels saturated after which such a scan is accepted.
constexpr int kMostImplausible = 10;

/// Why a result is not fit for control: bits; the values are those of posfet_msgs/TactileWrench.
constexpr std::uint8_t kBaselineUnknown = 1;
constexpr std::uint8_t kUncertain = 2;
constexpr std::uint8_t kTimeUncertain = 4;
constexpr std::uint8_t kScanUnusable = 8;
constexpr std::uint8_t kNoTaxel = 16;

/// What drives the path, each shared with the caller.
struct ScanParts {
  std::shared_ptr<ScanClock> clock;
  std::shared_ptr<CrosstalkCompensator> crosstalk;
  std::shared_ptr<BurstDetector> bursts;
  std::shared_ptr<HumFilter> hum;
  std::shared_ptr<ForceIntegration> integration;
  std::shared_ptr<CountHistory> history;
  std::shared_ptr<ContactFinder> finder;
  std::shared_ptr<ContactTracker> tracker;
  std::shared_ptr<DynamicChannel> channel;
};

/// Result of a scan; posfet_model/reconstruction/reconstructor.py explains each value.
struct ScanResult {
  bool accepted = false;
  bool unusable = false;
  bool valid = false;
  std::uint8_t reasons = 0;
  std::int64_t stamp = 0;  ///< [ns].
  std::uint64_t sequence = 0;
  std::size_t saturated = 0;
};

/// Forces and contacts of one sensor, scan by scan. Nothing is thrown but for lack of memory.
class ScanPath {
public:
  /// `offset` are the charge densities of each taxel without a force [C/m2]; `interpolation` limits what neighbours
  /// predict. Throws std::invalid_argument where parts are of different arrays, or missing.
  ScanPath(ScanParts parts, const InverseSignalChain& chain, std::vector<double> offset,
           const InterpolationLimits& interpolation);

  std::size_t taxels() const { return charge_.size(); }

  /// Take a scan, unless it is a duplicate or late: then it is refused, nothing else changes, and false is returned. A
  /// block that is due is closed between this and `begin`.
  bool receive(const Scan& scan);

  /// Process the scan that was received up to its forces. Returns false where the estimator has to start with it, after
  /// an interruption or with the first scan: then the caller sets the forces by `charge` before it calls `finish`.
  bool begin(const Scan& scan);

  /// Find and follow the contacts of the scan that was begun.
  void finish();

  const ScanResult& result() const { return result_; }

  const ScanClock& clock() const { return *parts_.clock; }

  /// Contacts of the result, ascending by id; released ones count only where `shows_released`.
  const Vector<Contact>& contacts() const { return parts_.tracker->contacts(); }
  bool shows_released() const { return shows_released_; }

  /// Vibration and slip of each contact that is not released, by its id.
  const Motions& motions() const { return parts_.channel->motions(); }

  /// Charge densities of the scan after compensation [C/m2].
  std::vector<double>& charge() { return charge_; }

  /// Taxels at the end of their range in the last scan that was read.
  TaxelFlags& saturated() { return saturated_; }

  /// Faulty taxels whose forces are interpolated from their neighbours.
  TaxelFlags& interpolated() { return interpolated_; }

  /// Forces of the taxels with those of faulty ones interpolated [N]; up to date while there are such.
  std::vector<double>& filled() { return filled_; }

  /// Standard uncertainty of each interpolated force [N]; up to date while there are such.
  std::vector<double>& filled_deviation() { return filled_deviation_; }

  /// Whether the newest scan that was neither duplicate nor late was unusable.
  bool blank() const { return blank_; }

  /// Whether the dynamic channel runs while nothing touches, too, and averages the power of each taxel.
  bool vibration_wanted = false;

  /// Use another filter of the mains hum, of the same array.
  void set_hum(std::shared_ptr<HumFilter> hum);

  /// Set the faulty taxels, which no contact lists (null: none), and those among them that are interpolated.
  void set_faulty(const bool* unlisted, const bool* interpolated);

  /// Set the variance of each force that it does not share with others [N2].
  void set_variance(const double* variance);

private:
  bool is_plausible(const Scan& scan);
  std::size_t counted_saturated() const;
  void flag(const Scan& scan);
  std::size_t find_with_faulty();
  const ForceEstimate& estimate();
  std::uint8_t reasons() const;

  ScanParts parts_;
  InverseSignalChain chain_;
  std::vector<double> offset_;
  bool any_offset_;
  InterpolationLimits interpolation_;
  std::vector<std::uint16_t> counts_;
  std::vector<double> charge_;
  TaxelFlags saturated_;
  std::size_t saturated_now_ = 0;
  int implausible_in_a_row_ = 0;
  bool fits_ = false;   ///< Whether the scan that was received has the layout of this sensor.
  bool begun_ = false;  ///< Whether `finish` has a scan to finish.
  bool blank_ = false;
  bool shows_released_ = false;
  ScanResult result_;
  std::vector<double> filled_;
  std::vector<double> filled_deviation_;
  TaxelFlags unlisted_;
  bool any_unlisted_ = false;
  TaxelFlags interpolated_;
  bool any_interpolated_ = false;
  TaxelFlags unknown_;
  std::vector<double> variance_;
  ForceEstimate estimate_;  ///< The same until the end of the block, but for the forces.
  std::vector<double> scan_variance_;
  ForceEstimate scan_estimate_;  ///< Of a scan with interpolated or saturated taxels.
};

}  // namespace posfet
