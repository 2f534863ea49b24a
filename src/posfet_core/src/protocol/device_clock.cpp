// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_core/protocol/device_clock.hpp"

#include <algorithm>
#include <cmath>

namespace posfet::protocol {

Wide DeviceClock::elapsed(std::uint32_t reading, double expected) const {
  const std::uint32_t within = between(reading_, reading);
  Wide elapsed = within;
  const auto modulus = static_cast<double>(modulus_);
  if (expected > modulus / 2.0) {
    elapsed += std::max(rounded((expected - within) / modulus), Wide{0}) * static_cast<Wide>(modulus_);
  }
  return elapsed;
}

void DeviceClock::advance(const Reading& scan) {
  const double counted = counted_ + scan.expected;
  const std::uint32_t within = between(reading_, scan.reading);
  const bool wraps = scan.expected >= static_cast<double>(modulus_) / 2.0;
  // The longest of several periods is not that of the board where the time would be of the future.
  const bool too_long = scan.slack > 0.0 && sync_.delay(read_time_ + within, scan.arrival) < kEarliest;
  const bool fits = scan.fits && !too_long;
  if (within > 0 && fits && in_a_row_ == 0 && !wraps) {  // as nearly always
    const double late = late_ + within - scan.expected;
    late_ = 0.0 < late && late < scan.period ? late : 0.0;
    reading_ = scan.reading;
    read_time_ += within;
    time_ = read_time_;
    return;
  }
  const Wide since = elapsed(scan.reading, counted);
  if (since == 0) {
    repeat(counted, scan.expected <= scan.period, scan.arrival);
    return;
  }
  Wide time = read_time_ + since;
  if (in_a_row_ > 0 || !fits) {
    time = decide(time, count_on(counted), scan.arrival, scan.slack);
  }
  take(scan.reading, time);
}

void DeviceClock::restart(std::uint32_t reading, bool same_boot, Wide arrival) {
  const Wide went_on = read_time_ + ahead(reading);
  const double delay = sync_.delay(went_on, arrival);
  if (same_boot && known_ && kEarliest <= delay && delay <= kLatestRestart) {
    sync_.doubt(went_on, arrival, 0.0);
    take(reading, went_on);
    return;
  }
  known_ = true;
  sync_.reset();
  take(reading, reading);
}

/// Count on by the sequence, as the reading repeats the one before.
void DeviceClock::repeat(double counted, bool next_tick, Wide arrival) {
  in_a_row_ = std::min(in_a_row_ + 1, kFrozenReadings);
  repeated_ += frozen() ? 1U : 0U;
  const bool first = in_a_row_ == 1;
  const Wide time = count_on(counted);
  const Wide possible = not_of_future(time, arrival);
  if (possible == time && first && next_tick) {  // the clock stands still, or two scans were sampled at once
    sync_.widen(real(time - time_), arrival);
  }
  counted_ = counted + real(possible - time);
  time_ = possible;
}

/// The time by the sequence: a tick, but a scan is never sampled before the one before it.
Wide DeviceClock::count_on(double counted) const { return read_time_ + std::max(rounded(counted - late_), Wide{0}); }

/// That of two times which the arrival speaks for; what it leaves open is uncertain for a while.
Wide DeviceClock::decide(Wide read, Wide by_sequence, Wide arrival, double slack) {
  const double delay = sync_.delay(read, arrival);
  const double other = std::abs(sync_.delay(by_sequence, arrival));
  const bool right = kEarliest <= delay && delay <= other + kPrompt;
  const Wide time = other < std::abs(delay) && !right ? by_sequence : read;
  const Wide possible = not_of_future(time, arrival);
  if (possible != time) {  // neither is right
    return possible;
  }
  const double least = std::min(real(read), real(by_sequence) - slack);
  sync_.doubt(time, arrival, std::min(real(time) - least, real(time - time_)));
  return time;
}

/// The time, or the latest one that the arrival allows: the clock is in doubt then.
Wide DeviceClock::not_of_future(Wide time, Wide arrival) {
  const double delay = sync_.delay(time, arrival);
  if (!(delay < kEarliest)) {
    return time;
  }
  const Wide latest = time + rounded(delay / 1000.0);
  sync_.doubt(latest, arrival, real(latest - time_));
  return latest;
}

void DeviceClock::take(std::uint32_t reading, Wide time) {
  reading_ = reading;
  read_time_ = time_ = time;
  counted_ = late_ = 0.0;
  in_a_row_ = 0;
}

}  // namespace posfet::protocol
