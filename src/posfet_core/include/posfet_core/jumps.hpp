// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// Jumps of single taxels from scan to scan.
///
/// A jump is a change that differs from the one before, so that a fast slide is none. After lost scans nothing is
/// tested.
#pragma once

#include <vector>

#include "posfet_core/grid.hpp"

namespace posfet {

/// Number of consecutive scans that are refused at most.
constexpr int kMostInARow = 3;

/// Share of a jump that is left in the next scan unless it was a burst [1].
constexpr double kPersisting = 0.5;

/// Finds jumps, and remembers those of scans that were refused because of them.
class JumpDetector {
public:
  /// `least` is the least jump of a taxel that is tested [C/m2].
  JumpDetector(Taxel taxels, double least);

  Taxel taxels() const { return static_cast<Taxel>(last_.size()); }

  /// Set the limit of each taxel's jump [C/m2].
  void set_limits(const double* limits);

  /// Compare the charges of a scan [C/m2] with those of the scan before, which it follows without a gap if `adjacent`;
  /// `faulty` taxels are not tested. Returns whether some taxel jumped that did not in the scan before, unless a jump
  /// that was refused persists. The scan is then accepted by `accept` or refused by `refuse`; otherwise it is accepted.
  bool examine(const double* charge, bool adjacent, const bool* faulty);

  /// Keep the charges that were examined as those of the last scan.
  void accept();

  /// Forget the charges that were examined, but not their jump.
  void refuse();

  /// Jump of each taxel in the scan that was examined [C/m2].
  const std::vector<double>& jump() const { return jump_; }

  /// Taxels that jumped in it.
  const Mask& jumped() const { return jumped_; }

  /// Those among them that did not in the scan before.
  const Mask& fresh() const { return fresh_; }

private:
  bool persists() const;

  std::vector<double> limit_;
  std::vector<double> charge_;  ///< Of the scan that was examined.
  std::vector<double> change_;
  std::vector<double> jump_;
  std::vector<double> last_;     ///< Charges in the last scan that was accepted.
  std::vector<double> before_;   ///< Their change in it.
  std::vector<double> refused_;  ///< The jump that was refused last.
  Mask jumped_;
  Mask fresh_;
  Mask moved_;  ///< Taxels that jumped in the last scan that was accepted.
  int in_a_row_ = 0;
};

}  // namespace posfet
