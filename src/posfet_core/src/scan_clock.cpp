// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_core/scan_clock.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

namespace posfet {

namespace {

constexpr std::uint32_t kRestart = kBoardReset | kChargeReset;

/// Difference of two numbers; the nearest one that fits where it is out of range.
std::int64_t difference(std::int64_t one, std::int64_t other) {
  std::int64_t found = 0;
  if (!__builtin_sub_overflow(one, other, &found)) {
    return found;
  }
  return other < 0 ? std::numeric_limits<std::int64_t>::max() : std::numeric_limits<std::int64_t>::min();
}

std::int64_t difference(std::uint64_t one, std::uint64_t other) {
  constexpr auto kMost = static_cast<std::uint64_t>(std::numeric_limits<std::int64_t>::max());
  return one >= other ? static_cast<std::int64_t>(std::min(one - other, kMost))
                      : -static_cast<std::int64_t>(std::min(other - one, kMost));
}

}  // namespace

ScanClock::ScanClock(std::uint64_t layout, std::size_t taxels, double leak_time_constant, double scan_rate)
    : layout_(layout),
      taxels_(taxels),
      longest_(kLongestGap * leak_time_constant),
      period_(1.0 / scan_rate),
      shortest_period_(period_ / kJumpFactor),
      longest_period_(period_ * kJumpFactor),
      step_(period_) {
  const bool fits = taxels > 0 && leak_time_constant > 0.0 && scan_rate > 0.0;
  if (!fits) {
    throw std::invalid_argument("taxels, leak_time_constant and scan_rate must be positive");
  }
}

bool ScanClock::fits(const Scan& scan) {
  if (scan.layout == layout_ && (scan.status & kRestart) != 0) {
    note_restart(scan);
  }
  if (scan.layout == layout_ && scan.taxels == taxels_) {
    return true;
  }
  ++counts_.layout_mismatch;
  return false;
}

bool ScanClock::is_new(const Scan& scan) {
  if (!started_) {
    return true;
  }
  const std::int64_t ahead = difference(scan.sequence, sequence_);
  bool is_later = false;
  if (restart_ != 0) {
    is_later = scan.stamp >= restarted_;
  } else if (ahead == 0) {
    ++counts_.repeated;
    return false;
  } else {
    is_later = ahead > 0 || scan.stamp > stamp_;  // the sequence has restarted
  }
  if (is_later) {
    return true;
  }
  ++late_in_a_row_;
  if (late_in_a_row_ > kMostLate) {
    return true;
  }
  ++counts_.late;
  return false;
}

bool ScanClock::is_sound(const Scan& scan) {
  if ((scan.status & kAdcFault) != 0) {
    ++counts_.adc_fault;
    return false;
  }
  return true;
}

void ScanClock::refuse(const Scan& scan) {
  const std::uint64_t newest = refused_ > 0 ? newest_refused_ : sequence_;
  if (scan.layout == layout_ && difference(scan.sequence, newest) > 0) {
    newest_refused_ = scan.sequence;
    ++refused_;
  }
}

void ScanClock::admit(const Scan& scan) {
  interrupted_ = suspect_ = false;
  const std::int64_t ahead = started_ ? difference(scan.sequence, sequence_) : 1;
  close_ = 0 < ahead && ahead <= kClose && started_ && restart_ == 0;
  if (!started_) {
    step_ = period_;
  } else if ((restart_ & kBoardReset) != 0 || ahead <= 0) {
    reset(scan);
  } else {
    measure(scan, ahead);
  }
  started_ = true;
  sequence_ = scan.sequence;
  device_time_ = scan.device_time;
  stamp_ = scan.stamp;
  estimated_ = (scan.status & kTimeEstimated) != 0;
  late_in_a_row_ = 0;
  refused_ = 0;
  restart_ = 0;
  ++counts_.accepted;
}

/// Note that the board has restarted before a scan, unless that is the last admitted one once more.
void ScanClock::note_restart(const Scan& scan) {
  if (!started_ || scan.sequence != sequence_ || scan.stamp != stamp_) {
    restart_ |= scan.status & kRestart;
    restarted_ = scan.stamp;
  }
}

/// Bridge a restart of the board by the stamps, which continue.
void ScanClock::reset(const Scan& scan) {
  ++counts_.resets;
  suspect_ = true;
  odd_ = 0.0;
  bridge(static_cast<double>(difference(scan.stamp, stamp_)) * 1e-9);
}

/// Set the interval [s]; one out of range interrupts the force, and so does a charge that started again.
void ScanClock::bridge(double interval) {
  const bool in_range = 0.0 < interval && interval <= longest_;
  interrupted_ = (restart_ & kChargeReset) != 0 || !in_range;
  step_ = interrupted_ ? period_ : interval;
  counts_.gaps += interrupted_ ? 1 : 0;
}

/// Measure the interval before a scan that is `ahead` of the last one in sequence.
void ScanClock::measure(const Scan& scan, std::int64_t ahead) {
  counts_.missed += static_cast<std::uint64_t>(std::max<std::int64_t>(ahead - 1 - refused_, 0));
  const double expected = static_cast<double>(ahead) * period_;
  const bool estimated = estimated_ || (scan.status & kTimeEstimated) != 0;
  const double arrived = static_cast<double>(difference(scan.stamp, stamp_)) * 1e-9;
  double interval = estimated ? arrived : static_cast<double>(difference(scan.device_time, device_time_)) * 1e-6;
  const double each = interval / static_cast<double>(ahead);
  bool late = interval - expected > kJumpLeast && interval > kJumpFactor * expected;
  const bool repeats = std::abs(each - odd_) < kSameInterval * odd_ && std::abs(arrived - interval) < 0.5 * interval;
  if (late && repeats && !estimated) {  // the board was set to a lower rate
    period_ = each;
    longest_period_ = std::max(longest_period_, each);
    late = false;
  }
  odd_ = late ? each : 0.0;
  if (late || interval < 0.0 || (interval == 0.0 && !estimated)) {
    ++counts_.time_jumps;
    suspect_ = true;
    interval = expected;
  } else if (estimated) {
    // Arrival times have jitter, and come in bursts; the board itself scans at a constant rate.
    ++arrivals_;
    const auto count = static_cast<double>(ahead);
    update_period(each, std::max(1.0 / static_cast<double>(arrivals_), kEstimatedGain));
    period_ = std::clamp(period_, shortest_period_, longest_period_);  // they may come all at once, or stop
    interval = count * period_;
  } else if (ahead == 1) {
    update_period(interval, kPeriodGain);
  }
  bridge(interval);
}

void ScanClock::update_period(double interval, double gain) { period_ += gain * (interval - period_); }

}  // namespace posfet
