// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// A taxel whose force drifts alone while all else is still: its signal has stepped.
///
/// A signal that steps by D has another offset from then on: the uncorrected force drifts by D/tau. While the force
/// moves, the step itself is not seen (`signal_steps.hpp`), and while it is held, no zero shows the drift. But what
/// touches, once it is still, changes several taxels: in proportion to their forces (creep, leakage), or against each
/// other (tremor). A drift that one taxel has alone, and that stays the same, is that of its signal.
#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "posfet_core/flags.hpp"

namespace posfet {

/// Finds drifts of single taxels in windows of blocks.
class LoneDrift {
public:
  /// Blocks of a window.
  static constexpr std::size_t kBlocks = 16;

  /// Part of a drift up to which others change in the same time [1], assumed: of a force, neighbours feel more.
  static constexpr double kOthers = 0.4;

  /// Windows in a row that show the same drift, and the part by which it may differ from that of the first one [1]:
  /// what warms or cools differs by more.
  static constexpr std::size_t kWindows = 6;
  static constexpr double kSame = 0.15;

  /// A drift.
  struct Drift {
    std::size_t taxel;
    double rate;      ///< Of its force [N/s].
    double earliest;  ///< Time for which it may have been there [s],
    double latest;    ///< and for which it has been there.
  };

  explicit LoneDrift(std::size_t taxels);

  std::size_t taxels() const { return rate_.size(); }

  /// Process a block: mean forces [N], the taxels that count, that are in contact, and that are touched in any way; the
  /// variance of a mean [N2], and the duration of the block [s]. Returns a drift once it is known.
  std::optional<Drift> observe(const double* mean, const bool* counts, const bool* listed, const bool* touched,
                               double variance, double duration);

  /// Forget the last blocks: a correction since then is no drift.
  void restart() { seen_ = windows_ = 0; }

private:
  /// What a window shows.
  struct Window {
    std::size_t taxel;  ///< The one in contact whose force changes fastest,
    double own;         ///< by that more than in proportion to its force [N/s].
    double others;      ///< Greatest such rate of any other one [N/s].
    double noise;       ///< Standard deviation of a rate [N/s].
    double duration;    ///< [s].
  };

  void remember(const double* mean, const bool* listed, const bool* touched, double duration);
  double find_rates();
  void take_common(std::size_t but);
  Window window(const bool* counts, double variance);

  std::vector<std::vector<double>> means_;  ///< Mean forces of the last blocks, in turn [N],
  std::vector<double> times_;               ///< and the times of these blocks [s].
  std::size_t seen_ = 0;                    ///< Number of blocks.
  std::vector<std::size_t> listed_for_;     ///< Number of blocks for which a taxel has been in contact.
  std::vector<double> since_;               ///< Time since a taxel was untouched, or all was still [s].
  std::vector<double> rate_;                ///< Rates in a window [N/s].
  TaxelFlags held_;                         ///< Taxels that have been in contact for all of a window.
  std::size_t taxel_ = 0;                   ///< The taxel that drifts,
  std::size_t windows_ = 0;                 ///< in how many windows,
  double first_ = 0.0;                      ///< how fast in the first one [N/s],
  double sum_ = 0.0;                        ///< and the sum of that over all [N/s].
};

}  // namespace posfet
