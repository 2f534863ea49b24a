// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// Longest time that the frames of a scan occupy the bus, by the frames that have come.
#pragma once

#include "posfet_core/protocol/frame.hpp"

namespace posfet::protocol {

/// Longest time that the frames of a scan occupy the bus [s].
struct TransitTimes {
  double switched = 0.0;    ///< Classic frames, and those of CAN FD with bit rate switch.
  double unswitched = 0.0;  ///< CAN FD frames without bit rate switch.
};

/// Which of the two transit times holds: that without bit rate switch from the first such frame on.
class TransitTime {
public:
  /// Forget the frames that have come: the board was started, or the bus opened.
  void restart() { unswitched_ = false; }

  /// Note a frame of a scan.
  void see(const Frame& frame) { unswitched_ = unswitched_ || is_unswitched(frame); }

  /// The one that holds [s].
  double current() const { return unswitched_ ? times.unswitched : times.switched; }

  /// Both.
  TransitTimes times;

private:
  bool unswitched_ = false;
};

}  // namespace posfet::protocol
