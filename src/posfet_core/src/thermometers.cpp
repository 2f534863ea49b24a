// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_core/thermometers.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>

#include "posfet_core/numbers.hpp"

namespace posfet {

namespace {

std::uint32_t bits_of(float number) {
  std::uint32_t bits = 0;
  std::memcpy(&bits, &number, sizeof(bits));
  return bits;
}

}  // namespace

bool Thermometers::known() const {
  return std::any_of(sensors_.begin(), sensors_.end(), [](const Sensor& sensor) { return !std::isnan(sensor.last); });
}

double Thermometers::temperature() const {
  double sum = 0.0;
  int known = 0;
  for (const Sensor& sensor : sensors_) {
    if (!std::isnan(sensor.offset)) {
      sum += sensor.offset;
      ++known;
    }
  }
  return known > 0 ? sum / known + mean_ : kUnknown;
}

double Thermometers::read(const float* temperatures, std::size_t sensors, double step) {
  pass(step);
  if (is_repeated(temperatures, sensors)) {
    return kUnknown;
  }
  if (sensors > sensors_.size()) {
    sensors_.resize(sensors, {0.0F, kUnknown, kUnknown, 0.0, kUnknown});
  }
  reported_ = sensors;
  bool changed = false;
  for (std::size_t index = 0; index < sensors_.size(); ++index) {
    changed = take(sensors_[index], index < sensors ? temperatures[index] : std::numeric_limits<float>::quiet_NaN()) ||
              changed;
  }
  update_mean();
  if (changed) {
    follow_interval();
  }
  return changed ? mean_ : kUnknown;
}

/// Let time pass [s]; after an unknown time no change is too fast.
void Thermometers::pass(double step) {
  if (std::isfinite(step)) {
    time_ += step;
    return;
  }
  for (Sensor& sensor : sensors_) {
    sensor.came = kUnknown;
  }
  newest_ = kUnknown;
}

/// Note that a new reading came.
void Thermometers::follow_interval() {
  if (!std::isnan(newest_)) {
    const double since = time_ - newest_;
    interval_ = std::isnan(interval_) ? since : std::min(since, kIntervalGrowth * interval_);
  }
  newest_ = began_ ? time_ : kUnknown;
  began_ = true;
}

/// Take the reading of a sensor [degC]; return whether it is a new one.
bool Thermometers::take(Sensor& sensor, float reading) {
  const double value = std::isfinite(reading) ? reading : kUnknown;
  const bool changed = !std::isnan(value) && sensor.last != value;
  if (changed) {
    if (has_jumped(sensor, value)) {
      sensor.offset = kUnknown;
    }
    sensor.came = value;
    sensor.time = time_;
  }
  sensor.raw = reading;
  sensor.last = value;
  return changed;
}

/// Set the mean change by the sensors that report, and let those that are new begin with it.
void Thermometers::update_mean() {
  double sum = 0.0;
  int known = 0;
  for (const Sensor& sensor : sensors_) {
    const double change = sensor.last - sensor.offset;
    if (!std::isnan(change)) {
      sum += change;
      ++known;
    }
  }
  mean_ = known > 0 ? sum / known : mean_;
  for (Sensor& sensor : sensors_) {
    if (!std::isnan(sensor.last) && std::isnan(sensor.offset)) {
      sensor.offset = sensor.last - mean_;
    }
  }
}

/// Whether the readings are those of the scan before, bit by bit.
bool Thermometers::is_repeated(const float* temperatures, std::size_t sensors) const {
  if (sensors != reported_) {
    return false;
  }
  for (std::size_t index = 0; index < sensors; ++index) {
    if (bits_of(temperatures[index]) != bits_of(sensors_[index].raw)) {
      return false;
    }
  }
  return true;
}

/// Whether a sensor's reading changed faster than a temperature can.
bool Thermometers::has_jumped(const Sensor& sensor, double value) const {
  return !std::isnan(sensor.came) &&
         std::abs(value - sensor.came) > kReadingNoise + kFastestWarming * (time_ - sensor.time);
}

}  // namespace posfet
