// Copyright 2026 posfet maintainers
// Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
// the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
// applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
// governing permissions and limitations under the License.

/// Assembles the frames of a board with its own protocol into scans.
#pragma once

#include <cstdint>
#include <vector>

#include "posfet_core/protocol/mapped_tables.hpp"
#include "posfet_core/protocol/scan_statistics.hpp"

namespace posfet::protocol {

/// Sequence or time of a scan whose frames have held none yet, and block before the first.
constexpr int kNone = -1;

/// Scans behind the newest one whose frames count as late; more, and the counter has restarted or gone on.
constexpr int kLateScans = 8;

/// How far behind the newest scan frames are late, for a counter of so many bits.
Wide late_scans(unsigned bits);

/// Collects the frames of one scan at a time; a scan of which a frame is missing is counted and discarded.
///
/// When every frame holds the sequence, it tells which scan a frame belongs to, in whatever order the frames arrive.
/// Otherwise frames must arrive in the order of sending, and a scan begins with its first frame; a sequence or time
/// that only some frames hold must agree. As many frames lost in a row as a scan has cannot be noticed here.
class MappedAssembler {
public:
  /// The tables stay as long as this.
  explicit MappedAssembler(const MappedTables& tables);

  ScanStatistics statistics;

  /// Sequence of the current scan as sent, or kNone.
  Wide sequence() const { return sequence_; }

  /// Time of the current scan as sent, or kNone.
  Wide time() const { return time_; }

  /// Scans begun in vain since the last complete one.
  Wide incomplete() const { return incomplete_; }

  /// Scans by which the sequence has advanced since the last complete one, at least: incomplete ones tell.
  Wide passed() const { return passed_; }

  /// Note that the complete scan was numbered: both begin again.
  void clear_passed() { incomplete_ = passed_ = 0; }

  /// Whether a scan has begun and is not complete.
  bool collecting() const { return !abandoned_ && !whole(); }

  /// Add one frame, of the length that its message has; return whether it completed a scan.
  bool add(const MappedPart& part, const std::uint8_t* data);

  /// Write the counts of the complete scan to `out`.
  void decode_counts(std::uint16_t* out) const;

  /// Abandon the current scan; it is counted if it is incomplete.
  void abandon();

  /// Abandon the current scan, and let any sequence be the next.
  void forget();

private:
  /// A taxel's count in four bytes of the wire.
  struct Place {
    std::uint32_t at = 0;
    std::uint32_t base = 0;
    std::uint16_t mask = 0;
    std::uint8_t shift = 0;
    bool big = false;
  };

  bool whole() const { return received_count_ == received_.size(); }
  bool same_data(std::size_t block, const std::uint8_t* data) const;
  void receive(std::size_t block, const std::uint8_t* data);
  void fill();
  void begin();
  bool joins(std::size_t block, const std::uint8_t* data);
  bool leads(std::size_t block, Wide sequence, const std::uint8_t* data);
  bool continues(std::size_t block, Wide sequence, Wide time, const std::uint8_t* data);

  std::vector<std::size_t> offsets_;  ///< Of each block in the wire, and the length of all [byte].
  std::vector<std::uint8_t> wire_;    ///< Data of the frames of a scan, and padding.
  std::vector<Place> places_;
  const std::vector<std::uint16_t>& table_;
  std::vector<std::uint8_t> received_;  ///< Whether each block of the current scan has arrived.
  std::size_t received_count_ = 0;
  int highest_ = kNone;  ///< Last of the blocks that have arrived.
  Wide sequence_ = kNone;
  Wide time_ = kNone;
  Wide incomplete_ = 0;
  Wide passed_ = 0;
  int last_ = kNone;  ///< Block that arrived last.
  bool abandoned_ = true;
  bool joining_ = true;  ///< The first scan: its first frames may have been sent before this one listened.
  bool sequenced_;
  Wide wrap_;              ///< Number of values of a sequence.
  Wide newest_;            ///< How far ahead a sequence can be; beyond: late.
  bool repeats_are_told_;  ///< Else a single frame that repeats the previous one may be the next scan.
};

}  // namespace posfet::protocol
