// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// Stamps that never step back, whatever becomes known of the board's clock.
#pragma once

#include <algorithm>

#include "posfet_core/protocol/integers.hpp"

namespace posfet::protocol {

/// Orders the times of acquisition of the scans that are published.
///
/// A frame with a shorter delay than all before lowers the offset of the board's clock: the scans that follow were
/// acquired earlier than was known, and so may seem to be earlier than those published before. Until their times have
/// caught up, stamps advance at half the rate of the board's clock; by `excess` they are late meanwhile, and by no more
/// than the scan was delayed. Scans of one batch may have the same stamp: that of its arrival.
class AscendingStamps {
public:
  /// Time by which the newest stamp is later than the clock says [ns].
  Wide excess() const { return excess_; }

  /// The stamp of the next scan that is published: monotonic time [ns], from the stamp of the previous scan to
  /// `arrival`.
  ///
  /// `time` is its time of acquisition by the mapping of the board's clock [ns], `device_time` the same on the board's
  /// clock, unwrapped [us], and `arrival` the time at which it arrived [ns], not before that of the previous scan.
  Wide stamp(Wide time, Wide device_time, Wide arrival) {
    time = std::min(time, arrival);  // else all that follow would wait for a clock that was in error
    const Wide step = (device_time - device_time_) * 500;  // half of it [ns]
    const Wide least = stamp_ + std::max(step, Wide{0});
    const Wide stamp = time >= least ? time : std::max(std::min(least, arrival), stamp_);
    excess_ = stamp - time;
    device_time_ = device_time;
    stamp_ = stamp;
    return stamp;
  }

private:
  Wide excess_ = 0;
  Wide device_time_ = 0;  ///< Of the newest scan [us].
  Wide stamp_ = -kNever;  ///< Of the newest scan [ns].
};

}  // namespace posfet::protocol
