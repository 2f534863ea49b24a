// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

#include "posfet_core/protocol/classic_scans.hpp"

namespace posfet::protocol {

namespace {

std::uint32_t low_bits(std::int64_t sequence) {
  return static_cast<std::uint32_t>(static_cast<std::uint64_t>(sequence));
}

}  // namespace

ClassicScans::ClassicScans(Assembler& assembler, ClockSync& sync)
    : clock_(kHeaderClockBits, sync),
      numbering_(assembler.statistics, clock_, false),
      assembler_(assembler),
      sync_(sync),
      group_(ticks_, assembler),
      confirmed_(sync.save()) {}

void ClassicScans::announce(double period, bool confirmed) {
  const bool changed = numbering_.announce(period, confirmed);
  unconfirmed_ = !confirmed && (changed || unconfirmed_);
  if (changed) {
    adrift_ = true;  // the first scan at the new period has a header
    set_limits(period);
    restart_ticks();
    group_.drop_untimed();
  }
}

void ClassicScans::dispute_period(Wide arrival) {
  disputed_ = arrival;
  ticks_.question();
}

void ClassicScans::end_batch() {
  if (overflowed_) {
    overflowed_ = false;
    doubtful_ = true;
  }
}

void ClassicScans::hold(const Held& scan) {
  if (!group_.hold(scan)) {
    lose_number();
  }
}

void ClassicScans::lose_number() {
  adrift_ = true;
  group_.drop();
}

void ClassicScans::feed_header(const Frame& frame, Wide arrival) {
  group_.drop_released();
  const std::optional<ScanHeader> header = scan_header(frame);
  if (!header) {
    ++assembler_.statistics.malformed;
    return;
  }
  const std::optional<std::int64_t> before = missing(*header, arrival);
  if (!before) {
    doubtful_ |= header->boot == numbering_.boot();  // it is wrong, or what was counted since the last one
  } else if (*before < 0) {
    ++assembler_.statistics.duplicate;
  } else if (is_overtaken()) {
    ++assembler_.statistics.late;
  } else {
    take_header(*before, arrival);
  }
}

/// Take a header whose number was accepted, and before which some scans are missing.
void ClassicScans::take_header(std::int64_t missing, Wide arrival) {
  const bool begun = sequence_ == numbering_.sequence() && !adrift_ && !numbering_.restarted();
  const bool complete = begun && assembler_.complete();
  if (!begun) {
    assembler_.abandon();
  }
  draw_line(arrival);
  end_group(missing, complete);
  if (const Held* last = group_.last_released()) {
    delivered_ = last->sequence;
  }
  confirmed_ = sync_.save();
  sequence_ = header_ = numbering_.sequence();
  time_ = clock_.time();
  if (!begun) {
    assembler_.begin();
  }
  doubtful_ = overflowed_ || !ticks_.certain();
  adrift_ = false;
  fresh_ = !begun;
}

/// Draw the line of ticks through the newest header as well.
void ClassicScans::draw_line(Wide arrival) {
  if (numbering_.restarted()) {
    restart_ticks();
    delivered_ = -1;
  }
  ticks_.add(numbering_.sequence(), clock_.time(), clock_.stalled());
  numbering_.set_period(ticks_.nominal());
  set_limits(ticks_.nominal());
  if (ticks_.lowered()) {
    sync_.doubt(clock_.time(), arrival, 0.0);  // the times of the scans since were ahead of the clock
  }
  if (group_.waits()) {  // their times tell nothing, but may have to be stamped by this one
    sync_.to_monotonic(clock_.time(), arrival);
  }
}

bool ClassicScans::feed(std::size_t block, const Frame& frame, Wide arrival) {
  if (frame.length != kClassicLength || frame.kind != kClassic || block >= assembler_.blocks()) {
    ++assembler_.statistics.malformed;
    return false;
  }
  if (adrift_) {
    return false;
  }
  const unsigned ahead = (frame.data[0] - low_bits(sequence_)) & kClassicCounter;
  if (ahead > kCertain) {
    ++assembler_.statistics.late;
    return false;
  }
  const bool leaps = ahead > 1 || (fresh_ && ahead > 0);
  if ((ahead > 0 || fresh_) && !begin_scan(ahead, leaps, arrival)) {
    ++assembler_.statistics.late;
    return false;
  }
  if (exceeds(arrival, deadline_)) {
    doubtful_ = true;
  }
  if (ahead > 0) {
    assembler_.begin();
    group_.count_lost(ahead - 1);
    sequence_ = static_cast<std::int64_t>(static_cast<std::uint64_t>(sequence_) + ahead);
  }
  return add(block, leaps, frame.data);
}

/// Add a block to the current scan, which may leap over others; return whether it completed the scan.
bool ClassicScans::add(std::size_t block, bool leaps, const std::uint8_t* data) {
  const BlockOutcome outcome = assembler_.add(block, 0, data);
  if (outcome == BlockOutcome::kConflict) {
    lose_number();
    return false;
  }
  if (leaps && block > 0) {  // its first blocks are lost, or it was overtaken and is of the scan 16 earlier
    assembler_.abandon();
    return false;
  }
  if (outcome != BlockOutcome::kComplete) {
    return false;
  }
  if (!doubtful_) {
    ++group_.accounted;
    delivered_ = sequence_;
  }
  return true;
}

/// Take the time of a scan ahead of the current one, or of the current one with its first block; return false when it
/// is of the scan 16 earlier.
bool ClassicScans::begin_scan(unsigned ahead, bool leaps, Wide arrival) {
  const Wide time = ahead > 0 ? ticks_.time(sequence_ + ahead) : clock_.time();
  const double delay = sync_.delay(time, arrival);
  const bool early = delay < earliest_;
  if (early && ahead > 1) {
    return false;
  }
  deadline_ = real(arrival) + latest_ - delay - sync_.drift();
  doubtful_ |= early || (leaps && fresh_) || overflowed_ || !ticks_.certain();
  fresh_ = false;
  time_ = time;
  return true;
}

void ClassicScans::start() {
  numbering_.open();
  lose_number();
}

/// How many scans are missing before that of a header, as `ScanNumbering::missing` says.
std::optional<std::int64_t> ClassicScans::missing(const ScanHeader& header, Wide arrival) {
  if (adrift_ || !confirms(header)) {
    sync_.restore(confirmed_);
  }
  const Number number{header.boot, header.sequence, header.time};
  if (has_fallen(header)) {
    return numbering_.begin_again(number, arrival);
  }
  return numbering_.missing(number, arrival);
}

/// Whether blocks of later scans arrived before the newest header.
bool ClassicScans::is_overtaken() const {
  if (adrift_ || numbering_.restarted()) {
    return false;
  }
  const std::int64_t ahead = (doubtful_ ? delivered_ : sequence_) - numbering_.sequence();
  return 0 < ahead && ahead <= kLateBlocks;
}

/// Whether a header states what was counted since the one before, and a time that is not earlier.
bool ClassicScans::confirms(const ScanHeader& header) const {
  const std::uint32_t ahead = header.sequence - low_bits(sequence_) + kLateBlocks;
  if (header.boot != numbering_.boot() || ahead >= kHeaderScans + kLateBlocks) {
    return false;
  }
  const Wide counted = ticks_.time(sequence_ + ahead - kLateBlocks) - clock_.time();
  return real(counted - clock_.ahead(header.time)) <= kTolerance * numbering_.announced();
}

/// Whether a header follows the newest one, but not scans that were sent and numbered before it.
bool ClassicScans::has_fallen(const ScanHeader& header) const {
  if (header.boot != numbering_.boot() || delivered_ < 0) {
    return false;
  }
  const std::int64_t behind = low_bits(delivered_) - header.sequence;
  const std::int64_t ahead = delivered_ - numbering_.sequence();
  return (adrift_ ? -1 : kLateBlocks) < behind && behind < ahead;
}

/// Account for the scans since the newest header, and release those that were held and have the right number.
void ClassicScans::end_group(std::int64_t missing, bool next_complete) {
  if (header_ < 0 || numbering_.restarted()) {
    group_.restart();
    return;
  }
  const std::int64_t since = numbering_.sequence() - sequence_;
  const bool right = 0 <= since && since < kHeaderScans;  // else a block has overtaken its header
  group_.end(header_, missing, right, next_complete);
}

/// Begin another line of ticks, at the announced period; in question if that may not be the one in force.
void ClassicScans::restart_ticks() {
  ticks_.restart(numbering_.announced());
  if (unconfirmed_ || sync_.last() - disputed_ < kDispute) {
    ticks_.question();
  }
}

void ClassicScans::set_limits(double period) {
  if (period != period_) {
    period_ = period;
    earliest_ = -kTolerance * period * 1000.0;
    latest_ = kCertain * period * 1000.0;
  }
}

}  // namespace posfet::protocol
