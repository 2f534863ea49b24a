// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.
/// Monotonic time at which frames arrived, from the kernel's time stamps.
#pragma once

#include <algorithm>
#include <cstdint>

#include "posfet_core/protocol/integers.hpp"

namespace posfet::protocol {

/// Difference of two readings of the wall clock's offset [ns] above which the wall clock was set between them, or this
/// process was suspended while it read the two clocks; slewing by 500 ppm changes it by less within 0.2 s.
constexpr std::int64_t kOffsetTolerance = 100'000;

/// Maps the kernel's stamp of the newest frame of each read, on the wall clock, to monotonic time.
///
/// The frame arrived after the previous read and before this one, whatever the stamp says. Where the offset of the wall
/// clock is not that of the previous read, the time of this read replaces the stamp: the wall clock may have been set
/// after the frame had arrived.
class ArrivalTime {
public:
  /// The monotonic time at which the newest frame arrived [ns], from the previous read to `now`; `now` when nothing
  /// better is known. `stamp` is the wall time of its arrival [ns], 0 where that is unknown; `now` the monotonic time
  /// after the read [ns]; `wall_offset` the wall time less the monotonic one, read at `now` [ns].
  Wide of_newest(Wide stamp, Wide now, Wide wall_offset) {
    const Wide changed = wall_offset - last_offset_;
    const bool steady = -kOffsetTolerance < changed && changed < kOffsetTolerance;
    Wide arrival = stamp != 0 && steady ? stamp - std::min(wall_offset, last_offset_) : now;
    arrival = std::min(std::max(arrival, last_read_), now);
    last_read_ = now;
    last_offset_ = wall_offset;
    return arrival;
  }

private:
  Wide last_read_ = 0;
  Wide last_offset_ = 0;
};

}  // namespace posfet::protocol
