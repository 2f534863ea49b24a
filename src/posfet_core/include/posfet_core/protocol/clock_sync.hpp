// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// Synchronisation of a board's clock with the clock of this machine.
///
/// Arrival time minus device time is the clock offset plus the transit time, and the transit time is never below that
/// of an undelayed frame. The minimum of this difference is the estimated offset. It is raised by `kMaxDrift` per
/// second, so that a slow board clock is followed; a fast one lowers the minimum by itself. The error is the minimum
/// transit time (0.2 ms of frame and adapter), plus 0.2 ms for each second without an undelayed frame. These are
/// seconds between acquisitions: frames that wait to be read for a minute have drifted by no more than when they were
/// sent.
///
/// The minimum is that of the last ten seconds with frames. A clock that was set back makes all frames late: whether
/// that or a delay is the cause cannot be observed. The stamps are early by the shortest delay at most (`lead`), and
/// after ten seconds that delay counts as a step of the clock.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>

#include "posfet_core/numbers.hpp"
#include "posfet_core/protocol/integers.hpp"
#include "posfet_core/protocol/recent.hpp"

namespace posfet::protocol {

/// Greatest relative drift of the two clocks that is followed [s/s]: two crystals of 50 ppm each; assumed.
constexpr double kMaxDrift = 100e-6;

/// Time within which one frame has to arrive undelayed [ns].
constexpr Wide kWindow = 1'000'000'000;

/// Windows that are remembered: the offset rises when no frame of so many was undelayed. Assumed.
constexpr std::size_t kWindows = 10;

constexpr double kUnlimited = std::numeric_limits<double>::infinity();

/// What a window tells of the offset.
struct SyncWindow {
  Wide end = 0;         ///< When its last frame was acquired [ns].
  double offset = 0.0;  ///< The offset then, by the frames of the window alone [ns].
  Wide undelayed = 0;   ///< When the frame that determined it was acquired [ns].
};

/// What a `ClockSync` knows.
struct SyncState {
  double offset = 0.0;  ///< This machine's time less the device time, after the newest frame [ns].
  Wide last = 0;        ///< Arrival of the newest frame [ns].
  Wide acquired = 0;    ///< When the newest frame was acquired, as far as is known, and no earlier one later [ns].
  Wide undelayed = 0;   ///< The same of the frame that determined the offset.
  bool known = false;   ///< Whether there was a frame.
  Recent<SyncWindow, kWindows> windows;
  Wide window_end = 0;
  double window_offset = kUnlimited;  ///< By the frames of the present window alone.
  Wide window_undelayed = 0;
  bool doubted = false;               ///< The windows before tell nothing.
  double recent = kUnlimited;         ///< Offset by the frames since the window began, or an interruption.
  double recent_before = kUnlimited;  ///< The same of the window before.
};

/// Maps device time to this machine's monotonic time, using the frames with the shortest transit time.
class ClockSync {
public:
  double offset() const { return state_.offset; }
  bool known() const { return state_.known; }
  Wide last() const { return state_.last; }

  /// Possible drift of the offset since the last undelayed frame [ns]; NaN before the first frame.
  ///
  /// The offset is raised by `kMaxDrift` while the board's clock may be fast by as much. The minimum transit time adds
  /// to it: no mapping of this kind can observe it.
  double drift() const;

  /// Shortest delay of the frames of the last one or two seconds [ns]: stamps may be early by it; NaN before the first
  /// frame. After `interrupt` and `doubt` it is that of the frames since then.
  double lead() const;

  /// Possible error of the offset [ns], by drift or a step of the board's clock; NaN before the first frame.
  ///
  /// For a window after `interrupt` without the `lead`: the first frame may just have been delayed.
  double uncertainty() const;

  /// Time by which the offset may be too high, as device times may be ahead of the clock [ns].
  double excess() const { return std::max(state_.offset - lowest_, 0.0); }

  /// The largest error [ns] of a stamp by the newest frame, which may be late and early by some times [ns] whatever the
  /// offset, and is early by no more than the `delay` from the stamp to the arrival of its frame [ns].
  double error(double late, double early, double delay) const;

  /// How much later a frame, acquired at a device time [us], arrived [ns] than an undelayed one [ns]; NaN before the
  /// first frame.
  double delay(Wide device_time, Wide arrival) const;

  /// Discard the offset: the board's clock has restarted.
  void reset();

  /// Note that the board's clock may have been set unnoticed: the frames before no longer tell the `lead`.
  void interrupt(Wide device_time, Wide arrival);

  /// Note that the board's clock may have been set: within a window the offset is found by the frames from now on,
  /// whose device times may be `ahead` of the clock [us].
  void doubt(Wide device_time, Wide arrival, double ahead);

  /// Note that device times from now on may be `ahead` of the clock [us]: so much too high the offset may be.
  void widen(double ahead, Wide arrival);

  /// What is known, for `restore`.
  const SyncState& save() const { return state_; }

  /// Forget the frames since `save`, unless nothing was known then: their device times may have been wrong.
  void restore(const SyncState& state);

  /// The monotonic time [ns] that corresponds to a device time [us], by a frame that arrived at a monotonic time [ns];
  /// never after that.
  Wide to_monotonic(Wide device_time, Wide arrival);

private:
  void follow(Wide device_time, Wide arrival, double difference);
  void end_window(Wide arrival);

  SyncState state_;
  double lowest_ = kUnlimited;   ///< To which the offset may be too high, as device times may be ahead of the clock.
  Wide settled_ = kNever;        ///< When the frames since that was last noted have told [ns].
  Wide interrupted_ = -kWindow;  ///< When that was last noted [ns].
};

/// Wall time less monotonic time, read with each batch of frames.
///
/// Of two consecutive readings the smaller is used: a process that is suspended between its reads of the two clocks
/// reads too large a value.
class WallOffset {
public:
  /// The offset to be used [ns].
  std::int64_t value() const { return value_; }

  /// Take a reading [ns].
  void read(std::int64_t offset) {
    value_ = offset < last_ ? offset : last_;
    last_ = offset;
  }

private:
  std::int64_t value_ = 0;
  std::int64_t last_ = std::numeric_limits<std::int64_t>::max();
};

}  // namespace posfet::protocol
