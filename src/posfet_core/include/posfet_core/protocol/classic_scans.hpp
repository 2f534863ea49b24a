// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// Scans of classic blocks: 4 bits of the sequence in each block, and headers that state it in full.
///
/// Between two headers the sequence is counted on. That is certain while fewer than 16 scans can be missing, which the
/// time tells: a block whose number is 16 too low seems to be late by 16 scan periods. A scan with a block that may be
/// so late is held until the next header confirms its number. So is one whose time is not known, as the scan period may
/// have changed.
#pragma once

#include <cstdint>
#include <optional>

#include "posfet_core/protocol/clock_sync.hpp"
#include "posfet_core/protocol/device_clock.hpp"
#include "posfet_core/protocol/frame.hpp"
#include "posfet_core/protocol/scan_assembler.hpp"
#include "posfet_core/protocol/scan_format.hpp"
#include "posfet_core/protocol/scan_group.hpp"
#include "posfet_core/protocol/scan_numbering.hpp"
#include "posfet_core/protocol/tick_line.hpp"

namespace posfet::protocol {

/// A counter that is up to this far behind belongs to a late frame; further behind, scans were lost [1].
constexpr int kLateBlocks = 3;

/// Delay of a scan up to which its number is certain [scan periods].
constexpr unsigned kCertain = kHeaderScans - kLateBlocks - 1;

/// Time after another host has set the scan period in which an announced period may be an earlier one [ns]: as long as
/// responses may be late; assumed.
constexpr Wide kDispute = 2'000'000'000;

/// Assigns each classic block to its scan.
class ClassicScans {
public:
  /// `assembler` collects the blocks; `sync` is the mapping of the board's clock, which tells how late a scan is.
  ClassicScans(Assembler& assembler, ClockSync& sync);

  ClassicScans(const ClassicScans&) = delete;
  ClassicScans& operator=(const ClassicScans&) = delete;

  const DeviceClock& clock() const { return clock_; }
  ScanNumbering& numbering() { return numbering_; }
  const ScanNumbering& numbering() const { return numbering_; }

  /// Sequence of the current scan, -1 before the first; while `doubtful` it has to be confirmed by the next header.
  std::int64_t sequence() const { return sequence_; }

  /// Device time of the current scan, unwrapped [us]: that of its header, or of its tick when it has none.
  Wide time() const { return time_; }

  bool doubtful() const { return doubtful_; }

  /// Whether the time of the current scan is that of its header, or its number is certain; the first one's is.
  bool dated() const { return !doubtful_ || sequence_ == header_ || !sync_.known(); }

  /// Time by which a scan may have been sampled after its time [us]: one without a header, late.
  double early(std::int64_t sequence) const { return sequence == header_ ? kAgreement : numbering_.period(); }

  /// Time by which a scan may have been sampled before its time [us]: the headers may all have been late.
  double late() const { return ticks_.agreed() ? kAgreement : numbering_.period(); }

  /// Take a scan period that the board announces [us]; unless it is `confirmed`, as it was set, the next headers have
  /// to confirm it.
  void announce(double period, bool confirmed);

  /// Note that another host sets the scan period, by a command that arrived at a monotonic time [ns].
  void dispute_period(Wide arrival);

  /// Note that frames were lost within the present batch, nobody knows where: no time tells a block's number.
  void note_overflow() { overflowed_ = true; }

  /// End a batch of frames.
  void end_batch();

  /// Hold the current scan, which is complete, until its number is confirmed; too many are dropped.
  void hold(const Held& scan);

  /// Use no block until the next header; what is held is dropped, and counted then.
  void lose_number();

  /// Process a header that arrived at a monotonic time [ns]; the scans that were held and whose numbers are right are
  /// released (`group`).
  void feed_header(const Frame& frame, Wide arrival);

  /// Process the frame of a block that arrived at a monotonic time [ns]; return whether it completed a scan, which the
  /// assembler then holds.
  bool feed(std::size_t block, const Frame& frame, Wide arrival);

  /// Use no block until the next header, which may state any number: the board was started.
  void start();

  /// Scans that are held, and those that the newest header released.
  ScanGroup& group() { return group_; }

private:
  std::optional<std::int64_t> missing(const ScanHeader& header, Wide arrival);
  bool is_overtaken() const;
  bool confirms(const ScanHeader& header) const;
  bool has_fallen(const ScanHeader& header) const;
  void take_header(std::int64_t missing, Wide arrival);
  void draw_line(Wide arrival);
  void end_group(std::int64_t missing, bool next_complete);
  bool add(std::size_t block, bool leaps, const std::uint8_t* data);
  bool begin_scan(unsigned ahead, bool leaps, Wide arrival);
  void restart_ticks();
  void set_limits(double period);

  DeviceClock clock_;
  ScanNumbering numbering_;
  Assembler& assembler_;
  ClockSync& sync_;
  TickLine ticks_;
  ScanGroup group_;
  std::int64_t sequence_ = -1;
  Wide time_ = 0;
  bool doubtful_ = false;
  bool overflowed_ = false;
  double period_ = 0.0;        ///< By which the two limits are [us].
  double earliest_ = 0.0;      ///< Least delay of a block whose number is certain [ns].
  double latest_ = 0.0;        ///< Greatest such delay [ns].
  double deadline_ = 0.0;      ///< Arrival up to which the number of another block of the current scan is certain [ns].
  Wide disputed_ = -kDispute;  ///< When another host has last set the period [ns].
  bool unconfirmed_ = false;   ///< Only an identity states the announced period.
  std::int64_t header_ = -1;   ///< Sequence of the newest header.
  SyncState confirmed_;        ///< At the newest header.
  bool fresh_ = false;         ///< No block since the newest header.
  bool adrift_ = true;         ///< No number until the next header.
  std::int64_t delivered_ = -1;  ///< Sequence of the newest scan whose number was certain; -1 before the first.
};

}  // namespace posfet::protocol
