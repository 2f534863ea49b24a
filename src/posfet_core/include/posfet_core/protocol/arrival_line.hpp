// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// What the arrival of scans tells when a board sends no time, or a counter that wraps soon.
#pragma once

#include <limits>

#include "posfet_core/protocol/integers.hpp"

namespace posfet::protocol {

/// Greatest relative difference of the board's scan rate from the sensor file's: CAN needs such clocks, too.
constexpr double kStepTolerance = 0.005;
/// Smallest number of scans, of scan periods and of batches in which one scan has to arrive undelayed.
constexpr int kWindowScans = 32;
constexpr int kWindowBatches = 3;
/// Longest time that frames wait in adapter and kernel before they are read [ns]; assumed.
constexpr double kLongestDelay = 250e6;

/// Follows the arrival of undelayed scans, which is a straight line over their sequence.
///
/// A scan cannot arrive before the previous one plus its period, but later. The line therefore advances by one period
/// per scan, up to the arrival and not beyond. What remains between line and arrival is a delay, or scans that were
/// lost without trace, because the counter of the board has wrapped or there is none. A delay has gone when the frames
/// that were waiting have been read; lost scans never come.
class ArrivalLine {
public:
  /// Scan period [ns].
  explicit ArrivalLine(double period) : step_(period * (1.0 + kStepTolerance)) {}

  /// Monotonic time at which the newest scan would have arrived undelayed [ns].
  double time() const { return time_; }

  /// Monotonic time at which the newest batch was read [ns].
  Wide arrival() const { return arrival_; }

  /// Begin a batch of frames that was read at a monotonic time [ns]; at most so many scans can be in it.
  void begin_batch(Wide arrival, double scans);

  /// Let the next scan be undelayed.
  void restart();

  /// The time since the newest scan [ns]; the scans since then fit into it.
  double room() const { return real(arrival_) - time_; }

  /// Advance by `scans`, of which the last has arrived in this batch.
  void advance(Wide scans);

  /// How many times `span` was lost without trace before the newest scan; the line advances by it.
  ///
  /// `span` is the time after which a loss leaves no trace [ns]: that of one wrap of the board's counter or clock.
  Wide missing(double span);

private:
  void begin_window();

  double step_;
  double time_ = 0.0;
  Wide arrival_ = 0;
  double waiting_ = 0.0;  ///< Time that the frames after the first scan of the batch span [ns].
  bool first_ = false;    ///< No scan of the batch yet.
  double least_ = 0.0;    ///< Smallest delay in the window [ns].
  int scans_ = 0;
  int batches_ = 0;
  double window_end_ = 0.0;  ///< Frames that had been waiting are read in less than this [ns].
};

}  // namespace posfet::protocol
