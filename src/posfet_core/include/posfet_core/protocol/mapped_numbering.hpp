// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// Numbers and dates the scans of a board with its own protocol.
#pragma once

#include "posfet_core/protocol/arrival_line.hpp"
#include "posfet_core/protocol/ascending_stamps.hpp"
#include "posfet_core/protocol/clock_sync.hpp"
#include "posfet_core/protocol/mapped_assembler.hpp"
#include "posfet_core/protocol/mapped_tables.hpp"

namespace posfet::protocol {

/// Time by which counter or clock have to be ahead of the arrivals for a restart of the board [ns]; assumed.
constexpr double kResetMargin = 50e6;
/// Share of a pause without frames from which on whole scans are missing: less than a half, of two frames per scan.
constexpr double kMissingShare = 0.45;
/// The same in scans, after a long pause: frames come in batches.
constexpr double kMissingScans = 1.5;

/// Unwraps the board's counter and clock, each with the help of the other and of the arrivals.
///
/// Without a counter, the sequence is counted by the board's time, and without both by the arrivals (`ArrivalLine`).
/// Then lost scans are an estimate, and the scan rate of the sensor file has to be right to within `kStepTolerance`. A
/// counter or clock that moves further than the time since the previous scan allows has restarted.
class MappedNumbering {
public:
  MappedNumbering(const MappedTables& tables, MappedAssembler& assembler);

  /// Sequence of the newest scan, unwrapped; -1 before the first.
  Wide sequence() const { return sequence_; }

  /// Time of the newest scan on the board's clock, unwrapped [us].
  Wide device_time() const { return device_time_; }

  /// Whether the board restarted before the newest scan.
  bool was_reset() const { return was_reset_; }

  /// Whether the board's clock stands still while its scans go on.
  bool clock_frozen() const { return clock_frozen_; }

  /// Scans during which it stood still.
  Counter frozen_clock() const { return frozen_clock_; }

  /// As that of ClockSync, and that by the order of stamps [ns].
  double clock_uncertainty() const { return clock_.uncertainty() + real(ascending_.excess()); }

  /// Begin a batch of frames, those of others included, which was read at a monotonic time [ns].
  void begin_batch(Wide arrival, std::size_t frames);

  /// Whether a batch, read at a monotonic time [ns], has so few frames of the board for the time since the previous one
  /// that whole scans are missing.
  bool frames_are_missing(Wide arrival, std::size_t frames) const;

  /// Take the scan that the assembler has completed; return whether it is a new one, which is numbered then.
  bool accept();

  /// The monotonic time of acquisition of the newest scan [ns]; to be called once for each.
  Wide stamp();

private:
  /// How far counter and time have advanced.
  struct Advance {
    Wide scans = 0;
    Wide ticks = 0;
  };

  Advance advance();
  bool is_too_far(const Advance& by) const;
  Advance unwrapped(Advance by);
  Wide turns(Wide ahead) const;
  void watch_clock(Wide ticks);
  Wide scans_in(Wide ticks);
  void restart(Wide sequence);
  void take(Wide sequence, Wide ticks);

  MappedAssembler& assembler_;
  double period_;
  double tick_;
  double ticks_back_;
  std::size_t blocks_;
  bool counted_;
  bool timed_;
  Wide wrap_;
  Wide time_wrap_;
  Wide late_from_;  ///< How far ahead a counter has gone back.
  double counter_span_;
  double clock_span_;
  double span_;  ///< A loss of this length leaves no trace [ns].
  ArrivalLine line_;
  ClockSync clock_;
  AscendingStamps ascending_;
  Wide sequence_ = -1;
  Wide device_time_ = 0;
  Wide counter_ = 0;      ///< Sequence of the newest scan as sent.
  Wide wire_time_ = 0;    ///< Its time as sent.
  Wide ticks_ = 0;        ///< The same, unwrapped.
  double surplus_ = 0.0;  ///< Periods that the board's time is ahead of the counted scans.
  Wide still_ = 0;        ///< Consecutive scans with the same time.
  Counter frozen_clock_ = 0;
  bool was_reset_ = false;
  bool clock_frozen_ = false;
};

}  // namespace posfet::protocol
