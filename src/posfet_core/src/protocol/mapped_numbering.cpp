// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_core/protocol/mapped_numbering.hpp"

#include <algorithm>
#include <cmath>

#include "posfet_core/protocol/device_clock.hpp"

namespace posfet::protocol {

MappedNumbering::MappedNumbering(const MappedTables& tables, MappedAssembler& assembler)
    : assembler_(assembler),
      period_(tables.period),
      tick_(tables.tick),
      ticks_back_(tables.ticks_back),
      blocks_(tables.blocks()),
      counted_(tables.sequence_bits > 0),
      timed_(tables.time_bits > 0),
      wrap_(values_of(tables.sequence_bits)),
      time_wrap_(values_of(tables.time_bits)),
      late_from_(wrap_ - late_scans(tables.sequence_bits)),
      counter_span_(counted_ ? real(wrap_) * period_ : 0.0),
      clock_span_(timed_ ? real(time_wrap_) * tick_ : 0.0),
      span_(std::max({counter_span_, clock_span_, period_})),
      line_(tables.period) {}

void MappedNumbering::begin_batch(Wide arrival, std::size_t frames) {
  line_.begin_batch(arrival, static_cast<double>(frames) / static_cast<double>(blocks_));
}

bool MappedNumbering::frames_are_missing(Wide arrival, std::size_t frames) const {
  const double pause = real(arrival - line_.arrival()) / period_;
  const double missing = pause - static_cast<double>(frames) / static_cast<double>(blocks_);
  return missing > std::max(kMissingShare, std::min(kMissingShare * pause, kMissingScans));
}

bool MappedNumbering::accept() {
  was_reset_ = false;
  if (sequence_ < 0) {
    restart(assembler_.sequence());
    return true;
  }
  Advance by = advance();
  if (by.scans <= 0) {
    return false;
  }
  if (is_too_far(by)) {
    was_reset_ = true;
    clock_.reset();
    restart(counted_ ? assembler_.sequence() : sequence_ + 1);
    return true;
  }
  line_.advance(by.scans);
  if (const double unnoticed = real(line_.missing(span_)) * span_; unnoticed != 0.0) {
    by.scans += rounded(unnoticed / period_ / real(wrap_)) * wrap_;
    by.ticks += timed_ ? rounded(unnoticed / clock_span_) * time_wrap_ : Wide{0};
  }
  if (by.scans > 1) {
    const auto lost = static_cast<Counter>(std::max(by.scans - 1 - assembler_.incomplete(), Wide{0}));
    assembler_.statistics.lost_scans += lost;
    assembler_.statistics.missing_frames += lost * blocks_;
  }
  take(sequence_ + by.scans, ticks_ + by.ticks);
  return true;
}

Wide MappedNumbering::stamp() {
  const bool by_clock = timed_ && !clock_frozen_;
  const Wide time = by_clock ? clock_.to_monotonic(device_time_, line_.arrival()) : rounded(line_.time());
  return ascending_.stamp(time, device_time_, line_.arrival());
}

/// How far counter and time have advanced; no scans: not a new one.
MappedNumbering::Advance MappedNumbering::advance() {
  const Wide ticks = timed_ ? wrapped(assembler_.time() - wire_time_, time_wrap_) : Wide{0};
  if (timed_ && (ticks == 0 || still_ > 0)) {
    watch_clock(ticks);
  }
  if (counted_) {
    const Wide ahead = wrapped(assembler_.sequence() - counter_, wrap_);
    const bool next = ahead == 1 && assembler_.passed() <= 1 && real(ticks) * tick_ <= 2.0 * period_;
    return next ? Advance{ahead, ticks} : unwrapped({ahead, ticks});
  }
  if (!timed_ || clock_frozen_) {
    return {1 + assembler_.incomplete(), ticks};
  }
  if (exceeds(ticks, ticks_back_)) {
    ++assembler_.statistics.late;
    return {};
  }
  return {scans_in(ticks), ticks};
}

/// Whether counter or time are ahead of the arrivals: they have restarted.
bool MappedNumbering::is_too_far(const Advance& by) const {
  const double passed = std::max(real(by.scans) * period_, real(by.ticks) * tick_);
  return passed > kResetMargin && passed > (line_.room() + kResetMargin + 2.0 * period_) * (1.0 + kStepTolerance);
}

/// How far counter and time have advanced; whichever wraps later tells how often the other one has.
///
/// A scan with the counter of the newest one, or of one shortly before, is counted and not ahead.
MappedNumbering::Advance MappedNumbering::unwrapped(Advance by) {
  double expected = 0.0;
  const double span = real(by.ticks) * tick_;
  by.scans += turns(by.scans);
  const bool told = by.scans > 0 && by.scans == assembler_.passed();  // by the incomplete scans in between
  if (counter_span_ >= clock_span_) {
    if ((told || by.scans < late_from_) && timed_) {
      by.ticks += std::max(rounded((real(by.scans) * period_ - span) / clock_span_), Wide{0}) * time_wrap_;
    }
  } else if (span < clock_span_ / 2.0) {  // else the time has gone back
    expected = span / period_;
    by.scans += std::max(rounded((expected - real(by.scans)) / real(wrap_)), Wide{0}) * wrap_;
  }
  if (by.scans == 0) {
    ++assembler_.statistics.frozen_counter;
  } else if (!told && by.scans >= late_from_ && real(by.scans) - expected > real(wrap_) / 2.0) {
    ++assembler_.statistics.late;
    by.scans = 0;
  }
  return by;
}

/// The scans in the whole turns of the counter that incomplete scans show, if they fit the time.
Wide MappedNumbering::turns(Wide ahead) const {
  const Wide behind = assembler_.passed() - ahead;
  const Wide turns = behind > 0 ? (behind + wrap_ - 1) / wrap_ * wrap_ : Wide{0};
  const bool fits = (real(ahead + turns) - real(wrap_) / 2.0) * period_ <= line_.room();
  return fits ? turns : Wide{0};
}

/// Note whether the clock stands still for longer than its steps explain.
void MappedNumbering::watch_clock(Wide ticks) {
  still_ = ticks != 0 ? Wide{0} : still_ + 1;
  const bool frozen = still_ >= kFrozenReadings && real(still_) * period_ > 2.0 * tick_;
  frozen_clock_ += frozen ? 1U : 0U;
  if (frozen != clock_frozen_) {
    clock_frozen_ = frozen;
    clock_.reset();
  }
}

/// How many scans the board's time has advanced by.
///
/// Steps of the clock may be as long as a period, so that it advances by none and then by two. What is too little is
/// kept for the next scan, and slowly forgotten, for the rate of the sensor file is not exact.
Wide MappedNumbering::scans_in(Wide ticks) {
  double surplus = surplus_ + real(ticks) * tick_ / period_ - 1.0;
  const Wide lost = std::max(rounded(surplus), Wide{0});
  surplus -= real(lost);
  surplus_ = surplus - std::min(std::max(surplus, -kStepTolerance), kStepTolerance);
  return 1 + lost;
}

void MappedNumbering::restart(Wide sequence) {
  surplus_ = 0.0;
  line_.restart();
  take(std::max(sequence, Wide{0}), std::max(assembler_.time(), Wide{0}));
}

void MappedNumbering::take(Wide sequence, Wide ticks) {
  assembler_.clear_passed();
  sequence_ = sequence;
  ticks_ = ticks;
  counter_ = assembler_.sequence();
  wire_time_ = assembler_.time();
  device_time_ = rounded(real(ticks) * tick_ / 1e3);
}

}  // namespace posfet::protocol
