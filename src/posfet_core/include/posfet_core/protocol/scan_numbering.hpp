// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// Which boot and sequence a scan has, and how many scans are missing before it.
///
/// The sequence counts the ticks of the board's scan timer, so sequence and device time advance together. A number that
/// does not fit the time is used only when the next scan counts on from it: a counter that is frozen never does.
#pragma once

#include <cstdint>
#include <optional>

#include "posfet_core/protocol/device_clock.hpp"
#include "posfet_core/protocol/scan_statistics.hpp"

namespace posfet::protocol {

/// Scans by which a frame may be late [1]; one that is further behind belongs to another boot. Assumed.
constexpr std::uint32_t kLate = 64;

/// Difference of sequence and time that fits after a long gap [scan periods]: half of what one missing scan makes.
constexpr double kTolerance = 0.5;

/// The same after a short one [scan periods]: a busy board samples late, by less than a period. Assumed.
constexpr double kLatest = 0.99;

/// The same for long gaps [1]; assumed.
constexpr double kRateTolerance = 0.02;

/// Step of the sequence that fits while the board's clock stands still [1].
constexpr std::uint32_t kUntimed = 16;

/// A sequence that runs this many times faster than all clocks is implausible [1]: the scan period may be unknown.
constexpr double kFastest = 4.0;

/// Scan periods by which it may run ahead besides [1].
constexpr double kSlack = 16.0;

/// Result of `ScanNumbering::missing` for the newest scan itself.
constexpr std::int64_t kNewest = -1;

/// What a board states of a scan.
struct Number {
  int boot = 0;               ///< Number of the power-on, modulo 16.
  std::uint32_t low = 0;      ///< Low 32 bits of the sequence.
  std::uint32_t reading = 0;  ///< Device time as sent [us].
};

/// Owner of boot and sequence of a board's scans.
class ScanNumbering {
public:
  /// Counts what is late, implausible or frozen in `statistics`; reads `clock` with each scan that is accepted. With
  /// `cautious`, a number that does not fit needs a successor: a classic header comes too seldom for that.
  ScanNumbering(ScanStatistics& statistics, DeviceClock& clock, bool cautious)
      : statistics_(statistics), clock_(clock), cautious_(cautious) {}

  /// Number of the power-on of the newest scan; -1 before the first.
  int boot() const { return boot_; }

  /// Sequence of the newest scan, unwrapped; -1 before the first.
  std::int64_t sequence() const { return sequence_; }

  /// Whether the sequence began again with the newest scan; whoever has used it clears it.
  bool restarted() const { return restarted_; }
  void clear_restarted() { restarted_ = false; }

  /// Scan period [us], as announced, or as measured where the scans contradict it.
  double period() const { return period_; }
  void set_period(double period) { period_ = period; }

  /// Scan period [us], as announced.
  double announced() const { return announced_; }

  /// Take a scan period [us] that the board announces, in force from one of the ticks to come on; return whether it is
  /// another one than announced before. Unless it is `confirmed`, as it was set, it makes no jump of the sequence
  /// plausible.
  bool announce(double period, bool confirmed);

  /// Accept any sequence next: the board was started, or may have been reset.
  void open() { open_ = true; }

  /// Count no scan as missing before the next one: the board was stopped on request.
  void forget_gap() { gap_counts_ = false; }

  /// Take the number of another scan, which arrived at a monotonic time [ns], and return how many are missing before
  /// it: 0 when the sequence begins again, `kNewest` when the scan is the newest one, nothing when it is not to be
  /// used, which is counted.
  std::optional<std::int64_t> missing(const Number& number, Wide arrival);

  /// Take the number of a scan with which the sequence has begun again, as scans show that were sent before it; return
  /// the number of missing scans: 0, as nobody knows.
  std::int64_t begin_again(const Number& number, Wide arrival) { return restart(number, arrival); }

private:
  std::uint32_t ahead_of_newest(const Number& number) const {
    return number.low - static_cast<std::uint32_t>(static_cast<std::uint64_t>(sequence_));
  }
  double shortest_period() const;
  double longest_period() const;
  bool is_late(const Number& number) const;
  std::optional<std::int64_t> jump(const Number& number, Wide arrival);
  bool fits(std::uint32_t ahead, std::uint32_t reading, double expected) const;
  double expected(std::uint32_t ahead, std::uint32_t reading, Wide arrival) const;
  double elapsed(std::uint32_t reading, Wide arrival) const;
  bool is_successor(const Number& number);
  std::int64_t advance(std::uint32_t ahead, std::uint32_t reading, double expected, bool fits, Wide arrival);
  std::int64_t restart(const Number& number, Wide arrival);

  /// Least and greatest of the periods that ticks since the newest scan may have had besides [us].
  struct Earlier {
    double least = 0.0;
    double most = 0.0;
  };

  ScanStatistics& statistics_;
  DeviceClock& clock_;
  bool cautious_;
  int boot_ = -1;
  std::int64_t sequence_ = -1;
  bool restarted_ = false;
  double period_ = 0.0;
  double announced_ = 0.0;
  int previous_boot_ = -1;               ///< Before the newest restart.
  std::int64_t previous_sequence_ = -1;  ///< The last one before the newest restart.
  std::optional<Number> candidate_;      ///< Does not fit; needs a successor.
  bool open_ = true;                     ///< Any sequence is possible.
  bool gap_counts_ = true;
  Wide arrival_ = 0;           ///< Of the newest scan [ns].
  double step_ = 0.0;          ///< Period by the newest candidate and its successor [us].
  double set_ = 0.0;           ///< Scan period that was set, and not only stated [us].
  double shortest_set_ = 0.0;  ///< Shortest one since the newest scan [us].
  std::optional<Earlier> earlier_;
};

}  // namespace posfet::protocol
