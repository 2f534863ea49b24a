// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// Readings of the chip's temperature sensors: what is new in them.
///
/// Each sensor contributes its change since its first reading, so one that appears or disappears does not shift the
/// mean. A sensor that stops reporting (NaN) gives no new reading. One that jumps faster than a chip can warm did not
/// measure its temperature: it contributes its change from then on.
#pragma once

#include <cstddef>
#include <vector>

#include "posfet_core/numbers.hpp"

namespace posfet {

/// Greatest rate of a temperature [K/s], assumed.
constexpr double kFastestWarming = 3.0;

/// Change of a reading by noise and rounding that is always accepted [K], assumed.
constexpr double kReadingNoise = 0.1;

/// Growth of the interval of the readings with each one that takes longer [1]: those that were equal to the one before
/// look like a longer interval, so the shortest of late counts.
constexpr double kIntervalGrowth = 1.1;

/// Mean change of the chip temperature since the start, from sensors that may appear and disappear.
class Thermometers {
public:
  /// Whether a sensor reported in the last scan.
  bool known() const;

  /// Mean of all sensors that ever reported [degC]; NaN: none.
  double temperature() const;

  /// Mean change in a new reading [K]; NaN without one. `temperatures` are the readings of the sensors [degC], NaN: it
  /// does not report; `step` the time since the previous scan [s], inf: unknown.
  double read(const float* temperatures, std::size_t sensors, double step);

  /// Interval at which new readings come [s]; NaN: unknown so far. Of the first reading it is not known when it came.
  double interval() const { return interval_; }

private:
  /// One sensor; NaN where there is nothing to know.
  struct Sensor {
    float raw;      ///< What was read last, of any kind.
    double last;    ///< The reading in the last scan that changed [degC].
    double came;    ///< Its last new reading [degC].
    double time;    ///< When that came [s].
    double offset;  ///< Its reading at a mean change of zero [degC].
  };

  void pass(double step);
  bool take(Sensor& sensor, float reading);
  void update_mean();
  void follow_interval();
  bool is_repeated(const float* temperatures, std::size_t sensors) const;
  bool has_jumped(const Sensor& sensor, double value) const;

  std::vector<Sensor> sensors_;
  std::size_t reported_ = 0;  ///< Number of sensors in the last scan.
  double time_ = 0.0;
  double mean_ = 0.0;
  bool began_ = false;          ///< Whether there was a reading.
  double newest_ = kUnknown;    ///< When the last new reading came [s].
  double interval_ = kUnknown;  ///< Interval of the readings [s].
};

}  // namespace posfet
