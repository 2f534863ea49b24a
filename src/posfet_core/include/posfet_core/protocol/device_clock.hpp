// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// Device time of a board, unwrapped.
///
/// A reading that repeats the one before is no time of a later scan: the time is counted on by the sequence. Where
/// reading and sequence contradict each other, one of them has jumped, and the arrival decides. The reading is right if
/// the frame arrived after it, and not much later than by the sequence; else that of the two by which the frame is less
/// delayed. So the time goes on evenly, and the mapping of the clock with it; the mapping gets the
/// time by which it may be ahead if the other one was right.
///
/// A scan is sampled at its tick or later, and never earlier. What is counted on by the sequence is therefore counted
/// from the tick of the newest reading, not from the reading.
#pragma once

#include <cstdint>

#include "posfet_core/protocol/clock_sync.hpp"
#include "posfet_core/protocol/integers.hpp"

namespace posfet::protocol {

/// Consecutive repetitions of a device time from which on the clock is reported as frozen: a scan may be sampled at the
/// time of the one before.
constexpr int kFrozenReadings = 3;

/// Delays of a frame [ns] by which its reading is right though the sequence contradicts it, the latter besides the
/// delay by the sequence; assumed.
constexpr double kEarliest = -1e6;
constexpr double kPrompt = 5e6;

/// Delay of a frame [ns] up to which the clock has gone on though the sequence began again; assumed.
constexpr double kLatestRestart = 100e6;

/// A scan's number and time, as `DeviceClock::advance` takes them.
struct Reading {
  std::uint32_t reading = 0;  ///< Device time as sent [us].
  double expected = 0.0;      ///< Time since the previous reading by the sequence [us].
  bool fits = true;           ///< Whether the two agree.
  Wide arrival = 0;           ///< Monotonic time at which the scan arrived [ns].
  double period = 0.0;        ///< Scan period [us]: a scan is sampled late by less.
  double slack = 0.0;         ///< Time by which `expected` may be too long, as the scan period is not known [us].
};

/// Unwraps the device time of a board.
class DeviceClock {
public:
  /// `bits` of a reading, in [1, 32], and the mapping of this clock, which is reset when the clock starts again.
  DeviceClock(unsigned bits, ClockSync& sync) : modulus_(std::uint64_t{1} << bits), sync_(sync) {}

  /// Device time of the newest scan, unwrapped [us].
  Wide time() const { return time_; }

  /// Readings that repeat the one before while the clock is frozen; never falls.
  std::uint64_t repeated() const { return repeated_; }

  /// Time by which the newest reading was taken late, as far as is known [us].
  double late() const { return late_; }

  /// Whether the newest reading repeats the one before: `time` is computed from the sequence.
  bool stalled() const { return in_a_row_ > 0; }

  /// Whether the clock stands still while scans go on.
  bool frozen() const { return in_a_row_ >= kFrozenReadings; }

  /// Time in which the readings wrap by half [us]: what is longer, they do not tell alone.
  double half_turn() const { return static_cast<double>(modulus_) / 2.0; }

  /// The time from one reading to another, modulo the range of readings [us].
  std::uint32_t between(std::uint32_t earlier, std::uint32_t later) const {
    return static_cast<std::uint32_t>((std::uint64_t{later} - earlier) & (modulus_ - 1));
  }

  /// How far a reading is ahead of the newest one, modulo the range of readings [us]; 0 if unknown.
  std::uint32_t ahead(std::uint32_t reading) const { return known_ ? between(reading_, reading) : 0; }

  /// Greatest time since the newest scan was acquired [us], at a monotonic time [ns]; NaN before the first.
  double greatest_age(Wide arrival) const { return (sync_.delay(time_, arrival) + sync_.excess()) / 1000.0; }

  /// Time since the newest reading [us]; the same by the sequence [us] tells how often the clock has wrapped meanwhile.
  Wide elapsed(std::uint32_t reading, double expected) const;

  /// Take a reading of a later scan.
  void advance(const Reading& scan);

  /// Take the reading of a scan with which the sequence began again, and which arrived at a monotonic time [ns]. With
  /// the same number of the power-on the clock may have gone on.
  void restart(std::uint32_t reading, bool same_boot, Wide arrival);

  /// Note that the board may have been reset before the newest reading, whatever it states.
  void interrupt(Wide arrival) { sync_.interrupt(time_, arrival); }

private:
  void repeat(double counted, bool next_tick, Wide arrival);
  Wide count_on(double counted) const;
  Wide decide(Wide read, Wide by_sequence, Wide arrival, double slack);
  Wide not_of_future(Wide time, Wide arrival);
  void take(std::uint32_t reading, Wide time);

  std::uint64_t modulus_;
  ClockSync& sync_;
  Wide time_ = 0;
  std::uint64_t repeated_ = 0;
  std::uint32_t reading_ = 0;  ///< Newest, as sent [us].
  Wide read_time_ = 0;         ///< `time` when the reading changed last [us].
  double late_ = 0.0;          ///< Of the newest reading against its tick [us].
  double counted_ = 0.0;       ///< Time since then, by the sequence [us].
  int in_a_row_ = 0;
  bool known_ = false;
};

}  // namespace posfet::protocol
