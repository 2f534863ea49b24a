// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// Detection of rest: whether offsets may be estimated from the signals.
///
/// The model may start during a touch. A force that grows at a constant rate then looks like an offset (rate times
/// tau), and a held force leaks. So an offset counts as known only after the signals of the whole array have been
/// still: for a short time where they are all equal, as they are without touch, and otherwise for as long as a held
/// force takes to leak away.
#pragma once

#include <cstddef>
#include <vector>

namespace posfet {

/// Detects rest block by block, while some offset is unknown.
class RestDetector {
public:
  /// A signal is still within this many standard deviations of a reading [1].
  static constexpr double kStill = 8.0;

  /// A single moving taxel counts as motion only beyond this many times that limit [1]: it may be noisy.
  static constexpr double kSingleTaxelFactor = 10.0;

  /// Time constants of the leakage after which no held force is left in the signals [1].
  static constexpr double kLeaked = 5.0;

  /// Standard deviation of a reading [N]; greatest deviation of an untouched taxel's signal from the median [N];
  /// leakage time constant [s].
  RestDetector(std::size_t taxels, double noise, double offset_spread, double time_constant);

  std::size_t taxels() const { return signal_.size(); }

  /// Set the reference signals [N] from the first scan.
  void start(const double* signal);

  /// Process the signals [N] at the end of a block [s]; return whether the array is at rest. While the chip is warming,
  /// what the taxels have in common does not count as motion.
  bool update(const double* signal, const bool* ignored, double duration, bool warming);

  /// Whether a signal moved in the last block.
  bool moved() const { return moved_; }

private:
  bool has_moved(const double* signal, const bool* ignored, bool warming);

  double still_;
  double offset_spread_;
  double leak_time_;
  std::vector<double> signal_;  ///< Reference signals [N].
  double duration_ = 0.0;       ///< Time since the last motion [s].
  bool moved_ = false;
};

}  // namespace posfet
