// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// Decodes the frames of one board into complete, numbered and stamped scans. Knows no bus, thread or clock.
///
/// A thread reads frames, and for each batch calls
///
///     decoder.begin_batch(arrival, wall_offset);
///     for (each frame) {
///       Found found = decoder.feed(frame);         // kScan: decoder.scan() is complete
///       while (found == Found::kReleased && decoder.release()) { ... decoder.scan() ... }
///     }
///     decoder.end_batch();
///
/// Nothing is allocated after construction, and nothing throws. A decoder has one user at a time.
#pragma once

#include <array>
#include <cstdint>
#include <optional>

#include "posfet_core/protocol/ascending_stamps.hpp"
#include "posfet_core/protocol/classic_scans.hpp"
#include "posfet_core/protocol/clock_sync.hpp"
#include "posfet_core/protocol/fd_scans.hpp"
#include "posfet_core/protocol/frame.hpp"
#include "posfet_core/protocol/messages.hpp"
#include "posfet_core/protocol/power_ons.hpp"
#include "posfet_core/protocol/scan_assembler.hpp"
#include "posfet_core/protocol/scan_format.hpp"
#include "posfet_core/protocol/scan_statistics.hpp"
#include "posfet_core/protocol/transit_time.hpp"

namespace posfet::protocol {

/// Number of the newest own commands that are remembered: a link may delay their responses by some repetitions.
constexpr std::size_t kCommandsKept = 16;

/// What a frame has brought.
enum class Found : std::uint8_t {
  kNothing,
  kScan,      ///< A scan is complete: `scan()`.
  kReleased,  ///< Scans that were held have the right number: `release()` makes each the newest one.
  kStatus,
  kResponse,
  kIdentity,
};

/// A complete scan; its counts are those of the decoder's assembler.
struct CompleteScan {
  Wide stamp = 0;                       ///< Wall time of acquisition [ns].
  std::int64_t sequence = 0;            ///< Unwrapped.
  Wide device_time = 0;                 ///< The board's clock at acquisition [us], unwrapped; 0 while that is frozen.
  unsigned status = 0;                  ///< Bits of ScanStatus.
  Counter frames_lost = 0;              ///< Frames of the board that did not arrive or could not be used.
  double stamp_uncertainty = kUnknown;  ///< Largest error of the stamp [s]; NaN: unknown.
};

/// Decodes the frames of a bus and picks out those of one board.
class BoardDecoder {
public:
  /// Format of the scans, and identifier of the board's first frames.
  BoardDecoder(const ScanFormat& format, std::uint32_t base);

  BoardDecoder(const BoardDecoder&) = delete;
  BoardDecoder& operator=(const BoardDecoder&) = delete;

  /// Begin a batch of frames, which was read at a monotonic time [ns], with the wall time less the monotonic time [ns];
  /// what the batch before has released and nobody took is dropped.
  void begin_batch(std::int64_t arrival, std::int64_t wall_offset);

  /// Process the next frame of the batch.
  Found feed(const Frame& frame);

  /// Make the next scan that was released the newest one; return false when there is none.
  bool release();

  /// End the batch.
  void end_batch() { classic_.end_batch(); }

  /// The newest complete scan.
  const CompleteScan& scan() const { return scan_; }

  /// False until the board was identified and started: scans are ignored and not counted.
  bool receiving = false;

  /// Longest time that the frames of a scan occupy the bus.
  TransitTime transit_time;

  /// Frames that carry no scan, by cause; who feeds counts all of them.
  Traffic traffic;

  Assembler& assembler() { return assembler_; }

  /// Frames and scans that were lost or rejected, by cause.
  const ScanStatistics& statistics() const { return assembler_.statistics; }

  /// Number of complete scans.
  Counter scans() const { return scans_; }

  /// Number of times that the board was reset.
  Counter resets() const { return power_ons_.resets(); }

  /// Sequence of the scan that was begun last; -1 before the first.
  std::int64_t sequence() const { return fd() ? fd_.sequence() : classic_.sequence(); }

  /// Frames of the board that did not arrive or could not be used.
  Counter frames_lost() const;

  /// Number of times that the board repeated a device time, from the third in a row on: its clock is frozen.
  Counter frozen_clock() const { return clock().repeated(); }

  /// Possible error of a stamp by drift and steps of the clock, or its order [s]; NaN before the first frame.
  ///
  /// What else is known about the newest scan is in its `stamp_uncertainty`.
  double clock_uncertainty() const;

  /// Scan period that the board has announced [us].
  double announced_period() const { return numbering().announced(); }

  /// Scan period that the scans keep [us]: as announced, or as measured where they contradict that.
  double kept_period() const { return numbering().period(); }

  /// Set the scan period that the board keeps [us]; unless it is `confirmed`, as it was set, its scans have to confirm
  /// it.
  void set_period(double period, bool confirmed);

  /// Note a command that this driver sends: of the newest ones, the same frame is no other host's.
  void sent(const std::uint8_t* command, std::size_t length);

  /// Receive scans from now on, whatever their sequence: the board was started.
  void start();

  /// Accept any sequence next: the board is silent or does not scan, and may have been reset.
  void doubt_sequence() { numbering().open(); }

  /// Count no scan as lost before the next one: the board was stopped on request.
  void forget_gap() { numbering().forget_gap(); }

  /// Note that frames were lost within the next batch: numbers and headers tell which.
  void note_overflow() { classic_.note_overflow(); }

  /// Forget the newest status, which is too old: flags of classic scans are unknown, as before the first one.
  void forget_status() { state_.reset(); }

private:
  using Short = std::array<std::uint8_t, kShortLength>;

  bool fd() const { return assembler_.format().fd; }
  const DeviceClock& clock() const { return fd() ? fd_.clock() : classic_.clock(); }
  ScanNumbering& numbering() { return fd() ? fd_.numbering() : classic_.numbering(); }
  const ScanNumbering& numbering() const { return fd() ? fd_.numbering() : classic_.numbering(); }

  Found feed_fd(const Frame& frame);
  Found feed_classic(const Frame& frame, std::uint32_t offset);
  Found feed_other(const Frame& frame, std::uint32_t offset);
  void feed_command(const Frame& frame);
  bool is_own(const Frame& frame) const;
  Found apply_response(const Response& response);
  Found apply_status(const BoardState& state, const Frame& frame);
  Found apply_identity(const Frame& frame);
  Found malformed();
  void end_numbering(int boot);
  CompleteScan complete(bool dated);
  void publish(const CompleteScan& scan, Wide device_time, bool stalled);
  double uncertainty(Wide stamp) const;

  std::uint32_t base_;
  Assembler assembler_;
  ClockSync sync_;
  FdScans fd_;
  ClassicScans classic_;
  AscendingStamps ascending_;
  PowerOns power_ons_;
  WallOffset wall_offset_;
  Wide arrival_ = 0;  ///< Of the batch [ns].
  CompleteScan scan_;
  unsigned resets_ = 0;  ///< Flags of the next scan that is published: the one completed first may be dropped.
  Counter scans_ = 0;
  std::optional<BoardState> state_;  ///< The newest one.
  Short status_data_{};              ///< Data of its frame.
  std::array<std::optional<Short>, kCommandsKept> own_commands_;
  std::size_t next_command_ = 0;
};

}  // namespace posfet::protocol
