// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_core/estimation/sensor_readings.hpp"

#include <algorithm>
#include <cmath>

#include "posfet_core/numbers.hpp"

namespace posfet {

namespace {

/// Interval of the readings before it is known [s]: that of board status.
constexpr double kStatusInterval = 0.1;

/// Time after which a reading that has not changed counts again [intervals]: some are equal to the one before.
constexpr double kRepeated = 3.0;

/// Time for which the rounding error of such a reading is the same [s], assumed: it counts for no more in that time.
constexpr double kSameError = 1.0;

}  // namespace

void SensorReadings::start(ForceIntegration::Block& scans) {
  scans.reading = kUnknown;
  unread_ = leaked_time_ = 0.0;
}

void SensorReadings::take(ForceIntegration& integration, Passage& block) {
  ForceIntegration::Block& scans = integration.block();
  const Thermometers& thermometers = integration.thermometers();
  unread_ += scans.elapsed;
  leaked_time_ += scans.elapsed * scans.leak;
  block.leaked_time = leaked_time_;
  const double interval = std::isnan(thermometers.interval()) ? kStatusInterval : thermometers.interval();
  const bool repeated = std::isnan(scans.reading) && unread_ >= kRepeated * interval && thermometers.known();
  block.reading = repeated ? scans.sensors : scans.reading;
  block.reading_variance = variance_ * (repeated ? std::max(kSameError / unread_, 1.0) : 1.0);
  block.interval = std::min(unread_, interval);  // a reading that shows no change is none
  if (!std::isnan(block.reading)) {
    scans.reading = kUnknown;
    unread_ = 0.0;
  }
}

}  // namespace posfet
