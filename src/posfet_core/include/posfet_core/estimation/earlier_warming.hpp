// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// Whether the film has warmed at a constant rate since before the first scan.
///
/// Zero forces do not show that: the charge of a constant rate is constant, and counts as an offset. But the sensors
/// rise from what they are expected to read: their slope is that rate.
#pragma once

#include <optional>

namespace posfet {

/// A rate of the film's temperature.
struct FoundRate {
  double rate;       ///< [K/s].
  double deviation;  ///< Its standard deviation [K/s].
};

/// Line through what the sensors read beyond what is expected, while zero forces determine the film's temperature.
class EarlierWarming {
public:
  /// Fewest readings of which the scatter is known.
  static constexpr int kFewest = 8;

  /// Least standard deviation of a reading [K], assumed: its rounding.
  static constexpr double kLeastReading = 1e-3;

  /// Add a reading less the expected one [K] at a time since the start [s]. Return the rate if it is significant.
  std::optional<FoundRate> add(double time, double reading);

  /// Forget the readings.
  void reset() { *this = EarlierWarming{}; }

private:
  int count_ = 0;
  double time_ = 0.0;     ///< Mean time [s].
  double reading_ = 0.0;  ///< Mean reading [K].
  double spread_ = 0.0;   ///< Sum of the squares of the times about their mean [s2].
  double slope_ = 0.0;    ///< Sum of their products with the readings [K s].
  double squares_ = 0.0;  ///< Sum of the squares of the readings about their mean [K2].
};

}  // namespace posfet
