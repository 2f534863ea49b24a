// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_core/protocol/scan_numbering.hpp"

#include <algorithm>
#include <cmath>

namespace posfet::protocol {

namespace {

constexpr std::uint32_t kHalf = 1U << 31U;

}  // namespace

bool ScanNumbering::announce(double period, bool confirmed) {
  if (confirmed) {
    shortest_set_ = boot_ >= 0 ? std::min(shortest_set_, period) : period;
    set_ = period;
  }
  if (period == announced_) {
    return false;
  }
  if (boot_ >= 0) {
    earlier_ = Earlier{shortest_period(), longest_period()};
  }
  announced_ = period_ = period;
  return true;
}

double ScanNumbering::shortest_period() const { return earlier_ ? std::min(period_, earlier_->least) : period_; }

double ScanNumbering::longest_period() const { return earlier_ ? std::max(period_, earlier_->most) : period_; }

std::optional<std::int64_t> ScanNumbering::missing(const Number& number, Wide arrival) {
  const bool same_boot = number.boot == boot_;
  const std::uint32_t ahead = ahead_of_newest(number);
  if (same_boot && ahead == 0) {
    return kNewest;
  }
  if (is_late(number)) {
    ++statistics_.late;
    return std::nullopt;
  }
  const double time = expected(ahead, number.reading, arrival);
  if (same_boot && fits(ahead, number.reading, time)) {
    return advance(ahead, number.reading, time, true, arrival);
  }
  if (cautious_ && boot_ >= 0 && !is_successor(number)) {
    candidate_ = number;
    return std::nullopt;
  }
  return jump(number, arrival);
}

/// Whether a scan was sent before one that was used, in this boot or the one before.
///
/// What a board sends after it was started is not late: the sequence has begun again.
bool ScanNumbering::is_late(const Number& number) const {
  if (number.boot == boot_) {
    return !open_ && 0U - ahead_of_newest(number) < kLate;
  }
  const auto last = static_cast<std::uint32_t>(static_cast<std::uint64_t>(previous_sequence_));
  return number.boot == previous_boot_ && number.low - last + kLate < 2 * kLate;
}

/// Take a number that does not fit the time.
std::optional<std::int64_t> ScanNumbering::jump(const Number& number, Wide arrival) {
  const bool same_boot = number.boot == boot_;
  const std::uint32_t ahead = ahead_of_newest(number);
  if (same_boot && (ahead - kSlack) * shortest_set_ <= kFastest * elapsed(number.reading, arrival)) {
    return advance(ahead, number.reading, expected(ahead, number.reading, arrival), false, arrival);
  }
  if (same_boot && !cautious_ && !open_) {
    ++statistics_.implausible;
    return std::nullopt;
  }
  return restart(number, arrival);
}

/// Greatest time since the newest scan on the clock of the host [us]; on the board's while none is mapped.
double ScanNumbering::elapsed(std::uint32_t reading, Wide arrival) const {
  const double age = clock_.greatest_age(arrival);  // it may have waited to be read for as long as the host stood still
  return std::max(real(arrival - arrival_) / 1000.0, std::isnan(age) ? clock_.ahead(reading) : age);
}

/// Whether a step of the sequence fits the time that has passed on the board's clock.
bool ScanNumbering::fits(std::uint32_t ahead, std::uint32_t reading, double expected) const {
  if (clock_.stalled() || clock_.ahead(reading) == 0) {
    return ahead <= kUntimed;
  }
  if (ahead > kUntimed && expected < (1 - kRateTolerance) * ahead * shortest_period()) {
    return false;  // so much has not passed on the clock of the host
  }
  // Against its tick, if that of the newest one is known.
  const double late = clock_.late() + real(clock_.elapsed(reading, expected)) - expected;
  const double most = std::max(kLatest * period_, kTolerance * period_ + kRateTolerance * expected);
  return ahead < kHalf && std::abs(late) <= most;
}

/// The time of a step of the sequence [us]; where the period has changed, the nearest to the reading.
///
/// More than half a turn of the board's clock, in which any reading fits some number of turns, is expected only if so
/// much has passed on the clock of the host.
double ScanNumbering::expected(std::uint32_t ahead, std::uint32_t reading, Wide arrival) const {
  double expected = ahead * period_;
  if (earlier_ && !clock_.stalled() && clock_.ahead(reading) != 0) {
    const double least = ahead * shortest_period();
    const double most = ahead * longest_period();
    expected = std::min(std::max(real(clock_.elapsed(reading, (least + most) / 2.0)), least), most);
  }
  const double half_turn = clock_.half_turn();
  return expected <= half_turn ? expected : std::min(expected, std::max(elapsed(reading, arrival), half_turn));
}

/// Whether a number counts on from the candidate; two that do so alike measure the scan period.
bool ScanNumbering::is_successor(const Number& number) {
  if (!candidate_ || candidate_->boot != number.boot) {
    return false;
  }
  const std::uint32_t step = number.low - candidate_->low;
  if (step == 0) {
    statistics_.frozen_counter += number.reading != candidate_->reading ? 1U : 0U;
    return false;
  }
  if (step > kUntimed) {
    return false;
  }
  const double measured = static_cast<double>(clock_.between(candidate_->reading, number.reading)) / step;
  const double before = step_;
  step_ = measured;
  for (const double period : {announced_, before}) {
    if (measured > 0.0 && std::abs(measured - period) <= kRateTolerance * period) {
      period_ = period;
      break;
    }
  }
  return true;
}

std::int64_t ScanNumbering::advance(std::uint32_t ahead, std::uint32_t reading, double expected, bool fits,
                                    Wide arrival) {
  const double shortest = fits || step_ == 0.0 ? shortest_period() : std::min(shortest_period(), step_);
  const double slack = std::max(expected - ahead * shortest, 0.0);
  clock_.advance({reading, expected, fits, arrival, period_, slack});
  if (open_ || ahead > kUntimed) {
    clock_.interrupt(arrival);
  }
  const bool counts = gap_counts_;
  earlier_.reset();
  shortest_set_ = set_;
  candidate_.reset();
  arrival_ = arrival;
  sequence_ = static_cast<std::int64_t>(static_cast<std::uint64_t>(sequence_) + ahead);
  gap_counts_ = true;
  open_ = false;
  return counts ? std::int64_t{ahead} - 1 : 0;
}

std::int64_t ScanNumbering::restart(const Number& number, Wide arrival) {
  const bool same_boot = number.boot == boot_;
  if (boot_ >= 0) {
    restarted_ = true;
    statistics_.implausible += same_boot && !open_ ? 1U : 0U;
  }
  clock_.restart(number.reading, same_boot, arrival);
  earlier_.reset();
  shortest_set_ = set_;
  candidate_.reset();
  previous_boot_ = boot_;
  previous_sequence_ = sequence_;
  boot_ = number.boot;
  sequence_ = number.low;
  arrival_ = arrival;
  gap_counts_ = true;
  open_ = false;
  return 0;
}

}  // namespace posfet::protocol
