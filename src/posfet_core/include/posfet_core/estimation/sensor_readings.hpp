// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// Which readings of the temperature sensors count, and how much.
#pragma once

#include "posfet_core/estimation/block.hpp"
#include "posfet_core/force_integration.hpp"

namespace posfet {

/// Counts each reading once; one that stays the same counts again after some intervals, but for its rounding error,
/// which stays the same, too.
class SensorReadings {
public:
  /// Standard deviation of a reading [K].
  explicit SensorReadings(double deviation) : variance_(deviation * deviation) {}

  /// Begin with a reading that says what zero is, and nothing else.
  void start(ForceIntegration::Block& scans);

  /// Take the reading of the scans of a block, if it counts.
  void take(ForceIntegration& integration, Passage& block);

private:
  double variance_;
  double unread_ = 0.0;       ///< Time since the last reading [s].
  double leaked_time_ = 0.0;  ///< `Passage::leaked_time` of the newest block [s].
};

}  // namespace posfet
