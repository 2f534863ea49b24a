// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// Decodes the frames of a board with its own protocol into scans, by tables made from its DBC file.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "posfet_core/protocol/clock_sync.hpp"
#include "posfet_core/protocol/frame.hpp"
#include "posfet_core/protocol/mapped_assembler.hpp"
#include "posfet_core/protocol/mapped_numbering.hpp"
#include "posfet_core/protocol/mapped_tables.hpp"
#include "posfet_core/protocol/scan_statistics.hpp"
#include "posfet_core/protocol/transit_time.hpp"

namespace posfet::protocol {

/// A complete scan, but for its counts and temperatures.
struct MappedScan {
  Wide stamp = 0;                       ///< Wall time of acquisition [ns].
  Wide sequence = 0;                    ///< Unwrapped.
  Wide device_time = 0;                 ///< The board's clock at acquisition [us], unwrapped; 0 if it sends none.
  unsigned status = 0;                  ///< Bits of ScanStatus.
  Counter frames_lost = 0;              ///< Frames of the board that did not arrive or could not be used.
  double stamp_uncertainty = kUnknown;  ///< Largest error of the stamp [s]; NaN: unknown.
};

/// Decodes the frames of a bus and picks out those that the tables name. Allocates memory when it is made only.
class MappedDecoder {
public:
  /// The tables are consistent.
  explicit MappedDecoder(const MappedTables& tables);

  MappedDecoder(const MappedDecoder&) = delete;
  MappedDecoder& operator=(const MappedDecoder&) = delete;

  /// Whether scans are received; otherwise they are ignored and not counted.
  bool receiving = false;

  /// Longest time that the frames of a scan occupy the bus.
  TransitTime transit_time;

  /// Frames that carry no scan, by cause.
  Traffic traffic;

  MappedAssembler& assembler() { return assembler_; }

  /// Counts of the newest complete scan.
  std::vector<std::uint16_t>& counts() { return counts_; }

  /// The newest temperatures [degC]; NaN: unknown.
  std::array<float, 2>& temperatures() { return temperatures_; }

  const MappedNumbering& numbering() const { return numbering_; }

  /// Number of complete scans.
  Counter scans() const { return scans_; }

  /// Number of times the board restarted between two scans, as far as counter or time show it.
  Counter resets() const { return resets_; }

  /// Bits of ScanStatus that the newest frames set.
  unsigned flags() const { return flags_; }

  /// Frames of the board that did not arrive or could not be used; an estimate without a sequence.
  Counter frames_lost() const;

  /// Possible error of the clock offset by drift or a step [s]; NaN without a board's time.
  double clock_uncertainty() const;

  /// The newest complete scan.
  const MappedScan& scan() const { return scan_; }

  /// Receive scans from now on, whatever their sequence: the bus was opened.
  void start();

  /// Note that frames were lost within the next batch: it is discarded when its frames do not tell where.
  void note_overflow() { overflowed_ = !gaps_show_; }

  /// Begin a batch of frames, of which so many are the board's, read at a monotonic time [ns], with the wall time less
  /// the monotonic time [ns]; return whether its frames are to be fed.
  bool begin_batch(std::size_t frames, std::size_t of_board, Wide arrival, std::int64_t wall_offset);

  /// Whether `begin_batch` has to be told how many frames are the board's.
  bool counts_frames() const { return assembler_.collecting() && !gaps_show_; }

  /// Whether a frame has the identifier and kind of one of the board's messages.
  bool is_of_board(const Frame& frame) const { return message_of(frame) != nullptr; }

  /// Process the next frame of the batch; return whether it completed a scan.
  bool feed(const Frame& frame);

private:
  const MappedMessage* message_of(const Frame& frame) const;
  void read(const MappedPart& part, const std::uint8_t* data);
  void count(const Frame& frame);
  void complete();

  MappedTables tables_;
  MappedAssembler assembler_;
  MappedNumbering numbering_;
  WallOffset wall_offset_;
  MappedScan scan_;
  std::vector<std::uint16_t> counts_;
  std::array<float, 2> temperatures_{};
  unsigned flags_ = 0;
  unsigned estimated_;  ///< Flag of every scan without a counter.
  bool gaps_show_;      ///< Frames tell where others were lost.
  bool overflowed_ = false;
  Counter scans_ = 0;
  Counter resets_ = 0;
};

}  // namespace posfet::protocol
