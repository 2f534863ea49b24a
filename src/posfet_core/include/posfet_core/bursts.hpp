// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// Single scans with electromagnetic interference; posfet_model/reconstruction/bursts.py says what is refused.
#pragma once

#include <cstdint>
#include <vector>

#include "posfet_core/flags.hpp"
#include "posfet_core/jumps.hpp"
#include "posfet_core/skin_response.hpp"

namespace posfet {

/// A jump is more than this many median differences of changes [1]: strong hum and vibration change in every scan.
constexpr double kUsualChanges = 8.0;

/// Standard deviations by which the neighbours of a jump must miss their part [1]: low, since a touch that is refused
/// in error is seen in the next scan.
constexpr double kBurstCertainty = 1.0;

/// Number of taxels from which a jump of all of them, at least half of which jump by more than the least, is no touch:
/// a fingertip covers fewer.
constexpr std::size_t kFewestOfBurst = 9;

/// Share of the greatest jump from which others are similar to it [1]: a fingertip presses its edge less.
constexpr double kEvenly = 0.15;

/// Share of the taxels that jump by similar amounts in a burst [1]: it lifts some of them by next to nothing.
constexpr double kMostOfBurst = 0.85;

/// Finds the scans with a burst, scan by scan.
class BurstDetector {
public:
  /// `least` is the least jump of a taxel that is tested [C/m2], `variance` that of a jump by noise [C2/m4],
  /// `charge_per_newton` the charge density per force [C/(m2 N)].
  BurstDetector(const SkinResponse& skin, double least, double variance, double charge_per_newton);

  Taxel taxels() const { return jumps_.taxels(); }

  /// Set the median difference of two changes of each taxel [N]; initially none.
  void set_usual_change(const double* change);

  /// Whether a scan with these charge densities [C/m2] has a burst; keeps them if not. `faulty` taxels are not tested.
  bool is_burst(const double* charge, std::uint64_t sequence, const bool* faulty);

private:
  bool is_no_touch(const bool* faulty);
  bool is_even() const;

  SkinResponse skin_;
  JumpDetector jumps_;
  double least_;
  double scale_;
  std::vector<double> variance_;
  std::vector<double> limits_;
  TaxelFlags sound_;
  bool started_ = false;
  std::uint64_t sequence_ = 0;  ///< Of the last scan.
};

}  // namespace posfet
