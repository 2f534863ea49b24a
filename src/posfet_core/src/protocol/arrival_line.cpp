// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_core/protocol/arrival_line.hpp"

#include <algorithm>
#include <cmath>

namespace posfet::protocol {

void ArrivalLine::begin_batch(Wide arrival, double scans) {
  arrival_ = arrival;
  waiting_ = std::max(scans - 1.0, 0.0) * step_;
  first_ = true;
}

void ArrivalLine::restart() {
  time_ = real(arrival_);
  begin_window();
}

void ArrivalLine::advance(Wide scans) { time_ = std::min(time_ + real(scans) * step_, real(arrival_)); }

Wide ArrivalLine::missing(double span) {
  const double delay = real(arrival_) - time_;
  least_ = std::min(least_, delay);
  scans_ = std::min(scans_ + 1, kWindowScans);
  batches_ = std::min(batches_ + (first_ ? 1 : 0), kWindowBatches);
  const bool first = first_;
  first_ = false;
  Wide lost = 0;
  if (first && delay - waiting_ > kLongestDelay) {  // even the last scan of this batch is late
    lost = rounded((delay - waiting_) / span);
  } else if (scans_ == kWindowScans && batches_ == kWindowBatches && !exceeds(-arrival_, -window_end_)) {
    lost = rounded(least_ / span);
  } else {
    return 0;
  }
  begin_window();
  time_ = std::min(time_ + real(lost) * span, real(arrival_));
  return lost;
}

void ArrivalLine::begin_window() {
  least_ = std::numeric_limits<double>::infinity();
  scans_ = batches_ = 0;
  window_end_ = real(arrival_) + (kWindowScans - 1) * step_;
}

}  // namespace posfet::protocol
